"""A bench run: a protocol followed case by case, from known weight to known weight, and the session that results."""
