"""Imports: the files that a model is made of, what each of them sees of the others, and one library of all."""
