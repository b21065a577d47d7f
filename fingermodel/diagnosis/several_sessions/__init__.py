"""Several sessions together: effects that they share, and a law that no catalogue lists."""
