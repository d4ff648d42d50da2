"""From returns to medians, and from medians to the plane that each of them hit."""
