"""Structure: agents, levels, couplings, parameters and experiments become nodes with scalar equations."""
