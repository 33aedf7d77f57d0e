const double both[2] = {x, y};
return exact_length(both, 2);
