"""Equations: one definition for each variable, and nothing that needs its own value."""
