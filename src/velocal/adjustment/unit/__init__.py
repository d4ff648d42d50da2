"""All lasers of a unit, the poses of its stations and the planes adjusted together."""
