/* What the integrator is given. Compiled once for all models; their generated code comes in as three functions:
 *
 *   field(x, u, c)      -> xdot (, A, B, P)      derivatives by x, u, p: only if there are columns of sensitivity
 *   reading(x, u, c, t) -> y    (, C, D, Q)
 *   jacobian(x, u, c)   -> A, B                  only for implicit steps
 *
 * c are constants of the parameters. Letters as everywhere: b batch, t samples, x states, u inputs, y sensors,
 * p parameters; s columns of sensitivity. All arrays row-major except the sparse derivatives (compressed columns).
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef long long integer;
typedef int (*Function)(const double **arg, double **res, integer *iw, double *w, int memory);
typedef struct { const integer *start, *row; } Pattern; /* of a sparse matrix: first entry of each column, rows */

#define STAGES 6
typedef struct { /* a Rosenbrock method, see rosenbrock.py */
    double a[STAGES][STAGES], c[STAGES][STAGES], alpha[STAGES], gamma_sum[STAGES], gamma;
} Rosenbrock;

typedef struct {
    Function field, reading, jacobian;
    integer first_row, end_row; /* of the batch: rows first_row … end_row - 1 are run */
    integer samples, states, coordinates, inputs, sensors, columns, groups, constants, parameters, sz_iw, sz_w;
    const integer *steps;        /* (t - 1): equal steps from each sample to the next */
    const double *time;          /* (t) */
    const double *input;         /* (t, u) */
    const double *constant;      /* (b, c) */
    const double *start;         /* (b, x) */
    const double *input_delay;   /* (b, u) */
    const double *group_delay;   /* (b, g): delay of a group of sensors */
    const integer *group;        /* (y): which group a sensor belongs to */
    double *state;               /* (b, t, x), or null */
    double *out;                 /* (b, t, y), or null */
    double *error;               /* (b, t - 1, y + x - n): see errors.c; or null */
    integer *failed;             /* (b, 2): first sample and state that is not finite, or -1 */
    const volatile int *stop;    /* the run ends when this is not 0 */
    /* sensitivity */
    const integer *selected;             /* (s): parameter of the column, or -1 */
    const double *start_derivative;      /* (x, s): of the start state */
    const double *input_delay_derivative;  /* (u, s) */
    const double *sensor_delay_derivative; /* (y, s) */
    double *derivative;                  /* (b, t, y, s) */
    Pattern A, B, P, C, D, Q;
    /* implicit steps; A and B above are the patterns of jacobian's results */
    const Rosenbrock *method;    /* null: explicit steps */
    const integer *place;        /* (x): row of each state in the banded matrix of a step */
    integer lower, upper;        /* its bandwidths below and above the diagonal */
} Run;

typedef struct {
    const Run *r;
    integer size;                /* of an augmented state: x·(1 + s) */
    const double *constant, *delay; /* of this row of the batch */
    double *u, *du, *rise, *rise_in_step, *y, *A, *B, *P, *C, *D, *Q, *w, *node[3], *stage[8];
    double *step_error;          /* (x): sum of the embedded errors of the steps since the last sample */
    double *band, *known_A, known_h; /* factors of a step's matrix, and what they were made of */
    integer *iw, *interval, *due, *pivot;
    double time_of_inputs;       /* the time that u and du belong to, or NaN */
} Work;
