"""s(x): by which rule an object stands where it is put."""
