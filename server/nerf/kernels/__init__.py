"""Fast kernels that equal the torch reference; one module per device and concern."""
