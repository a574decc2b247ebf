"""What changed between two campaigns: parameters, mechanisms, targets, noise."""
