"""Analytic scenes with exact buffers; requests are imported without what renders them."""
