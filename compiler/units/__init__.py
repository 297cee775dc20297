"""Units: the text between brackets as a factor to SI and exponents of the base units; the unit of every expression, and whether units agree."""
