"""Plan and emission: who calls what and where everything is found at run time, and the text of the generated module."""
