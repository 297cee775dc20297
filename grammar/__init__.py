"""The front of the compiler: source texts, the parser with its syntax tree, and problems shown at the user's own text.

`hierc.grammar.reading.read_source` opens a file, `hierc.grammar.parser.parse` makes the tree, `hierc.grammar.render.render`
shows what is wrong. Only the parser needs lark; importing this package does not load it.
"""
