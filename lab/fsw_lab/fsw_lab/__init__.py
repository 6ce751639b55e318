"""Commands and functions of the lab, commissioning, environment of Gymnasium."""
