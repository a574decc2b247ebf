"""The explanations that a diagnosis weighs against each other: kinds, priors, what each says of the arm."""
