"""The founding paper's single-stage capture: scene, imaging lens, microlens array, camera."""
