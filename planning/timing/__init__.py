"""Time parameterisation: curved paths, straight joint lines, and the samples made of them."""
