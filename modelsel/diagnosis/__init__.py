"""Naming the cause: scan, evidence, credible sets, stepwise search, outliers.

Its folders, each of which imports from those above it alone:

- `shapes`: shapes of errors that the registry of mechanisms lacks
- `candidates`: the explanations that are weighed against each other, with their priors
- `columns`: what each candidate moves at every row
- `inference`: how much each explains, and how probable that makes it
- `search`: effects added step by step, then weighed in sets
- `rivals`: what else could stand where an effect was named
- `faults`: rows that are far off, mistaken or exchanged
- `findings`: the named effects, how much of each is proven, and their sentences

The modules beside them are the whole procedure, which `diagnose` of `procedure` runs.
"""
