"""Pictures in time: films and live pictures."""
