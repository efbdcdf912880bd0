"""The measurements: figures for people who doubt, each with the conditions it was taken under."""
