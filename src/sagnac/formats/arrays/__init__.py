"""Files of named arrays: MATLAB and HDF5."""
