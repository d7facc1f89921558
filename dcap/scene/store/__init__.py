"""Values and foreign files kept by the digest of their content."""
