"""Export to POV-Ray, which renders the same scenes and optics by the founding paper's method."""
