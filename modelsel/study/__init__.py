"""The pipeline of a study, from its file to its result; fleets of studies."""
