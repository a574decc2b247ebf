"""What a run of a study computes, as plain values: findings, the error map, cards of mechanisms."""
