"""What a robot, a file of measurements or a study holds, before anything is fitted."""
