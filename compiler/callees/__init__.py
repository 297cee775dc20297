"""Callees: what a model calls that is not made of its own expressions, tables of data and external functions."""
