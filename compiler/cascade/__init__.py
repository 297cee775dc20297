"""The cascade: proof that no level depends on a later one, and the groups that get step sizes of their own."""
