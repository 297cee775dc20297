"""Arrays of agents: the elements that blocks have, and what can be wrong with them."""
