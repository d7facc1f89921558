"""Deformable, contact-aware object placement."""

from dcap.packages import claim_companions

claim_companions()
