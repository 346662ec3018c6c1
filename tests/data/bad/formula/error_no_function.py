# 2: inverse must be a function, not tuple
inverse = (0.0, 0.0)
