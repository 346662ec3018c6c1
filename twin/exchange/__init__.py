"""Foreign formats: `read` them, `write` them, `audit` what was written; none of the three imports another."""
