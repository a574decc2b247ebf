"""modelsel: what a robot's model gets wrong, why, and what is gained by saying so."""

__version__ = "0.1.0"
