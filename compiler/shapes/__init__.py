"""Types and shapes: expressions are evaluated to shaped values, and vectors and small matrices split into scalars on the way."""
