"""Claims of the paper that no table or figure answers: what was computed, and a verdict."""

#: Samples at one position, without and with the halogen light, as the paper says.
LIGHT = (("sa1", "sa2"), ("sa4", "sa3"))
