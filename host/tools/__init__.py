"""Programs for maintainers: synthesis, mutation, proofs, lint, registers. The product never imports these programs."""
