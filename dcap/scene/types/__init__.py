"""Values that the stages exchange: frozen, with units and shapes on every field."""
