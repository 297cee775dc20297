"""The multirate runtime: runs generated modules, each group of states at its own step."""
