"""The operator's page: a node that serves it and passes on what an operator asks for."""
