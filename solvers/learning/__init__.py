"""Training of policies and estimators: trainer, gradient steps and files of weights."""
