"""What the NMPC's preset ``adaptive`` gains and costs."""
