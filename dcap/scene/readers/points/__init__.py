"""Point clouds: which files hold them, and what each says."""
