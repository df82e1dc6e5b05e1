"""POV-Ray beside Lippmann: the founding paper's method, on the same scenes and optics."""
