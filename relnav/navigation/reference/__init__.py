"""The filters a second time, on filterpy (`engine="filterpy"`): a second opinion, for comparison."""
