"""Contact between bodies: the query, friction, bonds, rolling resistance, predictions."""
