"""Access to the service: address, origin, token, rate and size of a request. It imports `web` and `storage`."""
