"""Integration methods, one a file: coefficients as data with their source, and the step in the machine's dialect."""
