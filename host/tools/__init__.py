"""Programs for maintainers, such as synthesis, mutation tests, proofs and lint. The product imports none of them."""
