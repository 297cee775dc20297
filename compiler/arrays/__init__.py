"""Arrays of agents: columns of integers, the elements of blocks and their domains, and what can be wrong with them."""
