"""Numbers that a mechanic, a buyer or a controller takes: stiffnesses, angles, lags, mm at the target."""
