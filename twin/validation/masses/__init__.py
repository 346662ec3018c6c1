"""Which masses, centres and inertias of a source are possible, and what was probably meant."""
