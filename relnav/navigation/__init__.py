"""Where a sensor meets a filter."""
