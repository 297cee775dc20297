"""Makes valid models at random: units, expressions, functions, agents, files."""
