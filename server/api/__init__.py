"""REST, websockets, authentication and the wire schema."""
