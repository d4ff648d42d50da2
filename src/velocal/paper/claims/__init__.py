"""Claims of the paper that no table or figure answers: what was computed, and a verdict."""
