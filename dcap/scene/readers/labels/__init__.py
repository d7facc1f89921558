"""Labels next to a scene: a list of its things, ids of its vertices, a phone's plan of the room."""
