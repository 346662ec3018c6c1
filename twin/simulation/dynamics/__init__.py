"""The equations of motion of a serial arm, a plant in MuJoCo, and a controller between them."""
