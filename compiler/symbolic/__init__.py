"""The symbolic phase: one set of programs for all nodes of equal form, with derivatives, shared values and hoisted parameters."""
