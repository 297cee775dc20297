"""A plain interpreter of syntax trees: what models mean, told apart from how they are compiled."""
