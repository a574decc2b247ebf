"""What to do with a calibration: compensate, export, judge it anew; what to measure next; plug-ins."""
