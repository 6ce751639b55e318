"""Search for the gains of the decentralized controller, and what they are worth."""
