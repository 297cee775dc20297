"""The compiler: from syntax trees to the text of a Python module. `driver.py` sequences the phases, a folder each:

    resolve    what is declared, what every name stands for     cascade    no level depends on a later one; groups
    units      units known and agreeing, literals in SI         symbolic   programs, derivatives, shared values
    equations  one definition each, no loops                    emission   the plan, and the module's text
    shapes     vectors and matrices to scalars
    structure  agents, levels and couplings to nodes

`model.py` is what the front half (up to the cascade) hands to the back half; `expression.py` the scalar expressions in it.
"""
