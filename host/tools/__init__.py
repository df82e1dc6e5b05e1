"""Programs for maintainers: synthesis, mutation, proofs, lint, register generation. The product never imports them."""
