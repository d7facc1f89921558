"""What flows between the stages: frozen values with units and shapes on every field."""
