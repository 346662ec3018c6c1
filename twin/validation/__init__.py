"""Judging: the equations against the mechanism, the mechanism against its stage, the protocol against its RCM."""
