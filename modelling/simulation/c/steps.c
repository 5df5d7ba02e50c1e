/* One step from X with rate dX at time t to `next` at t + h: explicit, or implicit for stiff models. */

/* classical Runge-Kutta, order 4 */
static void explicit_step(Work *k, double t, double h, double end, const double *restrict X,
                          const double *restrict dX, double *restrict next) {
    double *restrict Y = k->stage[0], *restrict K2 = k->stage[1], *restrict K3 = k->stage[2], *restrict K4 = k->stage[3];
    integer size = k->size;
    for (integer e = 0; e < size; e++) Y[e] = X[e] + h / 2 * dX[e];
    set_rate(k, t + h / 2, Y, K2);
    for (integer e = 0; e < size; e++) Y[e] = X[e] + h / 2 * K2[e];
    set_rate(k, t + h / 2, Y, K3);
    for (integer e = 0; e < size; e++) Y[e] = X[e] + h * K3[e];
    set_rate(k, end, Y, K4);
    for (integer e = 0; e < size; e++) next[e] = X[e] + h / 6 * (dX[e] + 2 * (K2[e] + K3[e]) + K4[e]);
}

/* the banded matrix W = 1/(gamma·h) − A, row i: columns i − lower … i + upper, and room for `lower` more by pivoting */
#define ENTRY(i, j) k->band[(i) * width + (j) - (i) + lower]

/* W = L·U with partial pivoting; kept as long as A and h stay as they are */
static void factorise(Work *k, double h) {
    const Run *r = k->r;
    integer x = r->states, lower = r->lower, reach = r->lower + r->upper, width = lower + reach + 1;
    size_t bytes = sizeof(double) * (size_t)r->A.start[x];
    if (fabs(h - k->known_h) <= 1e-9 * h && !memcmp(k->A, k->known_A, bytes)) return;
    memcpy(k->known_A, k->A, bytes);
    k->known_h = h;
    memset(k->band, 0, sizeof(double) * (size_t)(x * width));
    for (integer j = 0; j < x; j++) {
        for (integer e = r->A.start[j]; e < r->A.start[j + 1]; e++) ENTRY(r->place[r->A.row[e]], r->place[j]) = -k->A[e];
        ENTRY(r->place[j], r->place[j]) += 1 / (r->method->gamma * h);
    }
    for (integer c = 0; c < x; c++) {
        integer below = c + lower < x ? c + lower : x - 1, right = c + reach < x ? c + reach : x - 1, p = c;
        for (integer i = c + 1; i <= below; i++)
            if (fabs(ENTRY(i, c)) > fabs(ENTRY(p, c))) p = i;
        k->pivot[c] = p;
        for (integer j = c; j <= right && p != c; j++) {
            double kept = ENTRY(c, j);
            ENTRY(c, j) = ENTRY(p, j), ENTRY(p, j) = kept;
        }
        ENTRY(c, c) = 1 / ENTRY(c, c); /* only divided by from here on */
        for (integer i = c + 1; i <= below; i++) {
            double factor = ENTRY(i, c) *= ENTRY(c, c);
            for (integer j = c + 1; j <= right && factor != 0; j++) ENTRY(i, j) -= factor * ENTRY(c, j);
        }
    }
}

/* v (x), in the order of the band: W⁻¹·v */
static void solve(const Work *k, double *v) {
    integer x = k->r->states, lower = k->r->lower, reach = lower + k->r->upper, width = lower + reach + 1;
    for (integer c = 0; c < x; c++) {
        integer below = c + lower < x ? c + lower : x - 1, p = k->pivot[c];
        double value = v[p];
        v[p] = v[c], v[c] = value;
        for (integer i = c + 1; i <= below; i++) v[i] -= ENTRY(i, c) * value;
    }
    for (integer c = x; c-- > 0;) {
        integer top = c > reach ? c - reach : 0;
        double value = v[c] *= ENTRY(c, c);
        for (integer i = top; i < c; i++) v[i] -= ENTRY(i, c) * value;
    }
}

/* Rosenbrock method (linearly implicit Runge-Kutta); Hairer and Wanner, Solving ODEs II, section IV.7, (7.25) */
static void implicit_step(Work *k, double t, double h, double end, const double *X, const double *dX, double *next) {
    const Run *r = k->r;
    const Rosenbrock *method = r->method;
    integer x = r->states;
    double *rhs = k->stage[6], *drive = k->stage[7]; /* drive = B·du/dt, the explicit time derivative of the field */
    set_inputs(k, t + h / 2);                        /* du there: at t itself an input may have a kink */
    memset(drive, 0, sizeof(double) * (size_t)x);
    k->time_of_inputs = NAN;
    double *du = k->rise_in_step;
    memcpy(du, k->du, sizeof(double) * (size_t)r->inputs);
    set_inputs(k, t);
    const double *arg[3] = {X, k->u, k->constant};
    double *res[2] = {k->A, k->B};
    r->jacobian(arg, res, k->iw, k->w, 0);
    add_product(&r->B, k->B, r->inputs, du, 1, drive);
    factorise(k, h);
    for (int i = 0; i < STAGES; i++) {
        double *U = k->stage[i];
        memcpy(next, X, sizeof(double) * (size_t)x);
        for (int j = 0; j < i; j++)
            for (integer e = 0; e < x; e++) next[e] += method->a[i][j] * k->stage[j][e];
        if (i == 0) memcpy(U, dX, sizeof(double) * (size_t)x);
        else set_rate(k, method->alpha[i] == 1 ? end : t + method->alpha[i] * h, next, U);
        for (int j = 0; j < i; j++)
            for (integer e = 0; e < x; e++) U[e] += method->c[i][j] / h * k->stage[j][e];
        for (integer e = 0; e < x; e++) rhs[r->place[e]] = U[e] + h * method->gamma_sum[i] * drive[e];
        solve(k, rhs);
        for (integer e = 0; e < x; e++) U[e] = rhs[r->place[e]];
    }
    for (integer e = 0; e < x; e++) next[e] += k->stage[STAGES - 1][e];
}
