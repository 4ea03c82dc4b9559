"""Many recordings and many turbines: what one session is not large enough for."""
