"""Units: the text between brackets as a factor to SI and exponents of the base units; every unit is known, every declared one coherent."""
