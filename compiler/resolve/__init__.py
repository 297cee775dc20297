"""Names: what a file declares, what every name stands for, which parameters are built into the code, and the values of constants."""
