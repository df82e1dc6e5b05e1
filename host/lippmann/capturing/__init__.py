"""The founding paper's single-stage capture: scene, lens, microlens array, camera."""
