"""What a study file names: robot, measurements, mechanisms, noise; all that is wrong with them said at once."""
