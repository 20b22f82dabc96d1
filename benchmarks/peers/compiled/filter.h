/* The memory of the filter of `by_hand.py` in C and in C++: doubles alone, matrices row by row, so that Python hands it
   over as one array. An answer is 43 doubles: range, state (6), covariance (6, 6). */
typedef struct {
    double focal, sigma, half_spacing, distance, gate; /* gate: the limit of NIS */
    double beacons[3][3], dock[3][3], cam_from_dock[3][3];
    double phi[6][6], q[6][6], effect[6][3];
    double x[6], p[6][6];
} Filter;

enum { ANSWER = 43, PASSES = 40 };
