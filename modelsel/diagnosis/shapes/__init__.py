"""Shapes of errors that the registry lacks: functions of joints, torques, time and other drivers."""
