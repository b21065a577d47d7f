"""The extensor hood as a network of tension-only springs on the bones, at its least potential energy."""
