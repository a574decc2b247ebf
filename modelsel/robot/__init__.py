"""The nominal arm: kinematics, gravity, robot files."""
