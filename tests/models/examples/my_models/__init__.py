"""Functions of the boat."""
