"""The founding paper's single-stage capture: scene, imaging lens, microlens array, and a camera that looks at it."""
