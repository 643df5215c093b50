"""One run from a model to a verified solution, and the verbs that make several of them."""
