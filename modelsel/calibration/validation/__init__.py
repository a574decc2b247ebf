"""Whether a calibration still holds on new data, and what they say where it does not."""
