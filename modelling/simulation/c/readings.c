/* Readings of the sensors, which may be taken between the steps (delays). */

/* readings of one group of sensors, of sample number `sample`, from the state X with rate dX at time t */
static void read_group(Work *k, integer b, integer sample, integer g, double t, const double *X, const double *dX) {
    const Run *r = k->r;
    integer m = r->sensors, at = (b * r->samples + sample) * m;
    set_inputs(k, t);
    const double *arg[4] = {X, k->u, k->constant, r->time + sample};
    double *res[4] = {k->y, k->C, k->D, k->Q};
    r->reading(arg, res, k->iw, k->w, 0);
    for (integer j = 0; j < m; j++)
        if (r->group[j] == g) r->out[at + j] = k->y[j];
    integer x = r->states, s = r->columns;
    if (!s) return;
    double *derivative = k->y + m, *rate = derivative + m * s; /* dy by the columns; dy/dt */
    memset(derivative, 0, sizeof(double) * (size_t)(m * (s + 1)));
    add_product(&r->C, k->C, x, X + x, s, derivative);
    add_direct(k, &r->Q, k->Q, &r->D, k->D, derivative);
    if (g > 0) { /* a longer delay reads earlier */
        add_product(&r->C, k->C, x, dX, 1, rate);
        add_product(&r->D, k->D, r->inputs, k->du, 1, rate);
        for (integer j = 0; j < m; j++)
            for (integer c = 0; c < s; c++) derivative[j * s + c] -= rate[j] * r->sensor_delay_derivative[j * s + c];
    }
    for (integer j = 0; j < m; j++)
        if (r->group[j] == g) memcpy(r->derivative + (at + j) * s, derivative + j * s, sizeof(double) * (size_t)s);
}

/* outside the recording the system moves as at its end: angles run on, or back, with their speeds */
static void extrapolate(const Work *k, double earlier, const double *X, double *Y, double *dY) {
    const Run *r = k->r;
    integer n = r->coordinates, s = r->columns, x = r->states;
    memcpy(Y, X, sizeof(double) * (size_t)k->size);
    memset(dY, 0, sizeof(double) * (size_t)k->size);
    for (integer i = 0; i < n; i++) {
        Y[i] -= earlier * X[n + i];
        dY[i] = X[n + i];
        for (integer c = 0; c < s; c++) Y[x + i * s + c] -= earlier * X[x + (n + i) * s + c];
    }
}

/* cubic Hermite between two nodes h apart, at the fraction z, with its time derivative */
static void interpolate(integer size, double h, double z, const double *X, const double *dX, const double *Y,
                        const double *dY, double *Z, double *dZ) {
    double a = (1 + 2 * z) * (1 - z) * (1 - z), b = h * z * (1 - z) * (1 - z), c = z * z * (3 - 2 * z), d = h * z * z * (z - 1);
    double e = 6 * z * (z - 1) / h, f = (1 - z) * (1 - 3 * z), g = z * (3 * z - 2);
    for (integer i = 0; i < size; i++) {
        Z[i] = a * X[i] + b * dX[i] + c * Y[i] + d * dY[i];
        dZ[i] = e * (X[i] - Y[i]) + f * dX[i] + g * dY[i];
    }
}

/* every group's readings that are due up to the end of the step from X at t to Y at t + h */
static void read_step(Work *k, integer b, double t, double end, const double *X, const double *dX, const double *Y,
                      const double *dY) {
    const Run *r = k->r;
    const double *delay = r->group_delay + b * r->groups;
    double *Z = k->stage[6], *dZ = k->stage[7];
    for (integer g = 0; g < r->groups && r->out; g++)
        for (; k->due[g] < r->samples && r->time[k->due[g]] - delay[g] <= end; k->due[g]++) {
            double at = r->time[k->due[g]] - delay[g];
            if (at == end) {
                read_group(k, b, k->due[g], g, end, Y, dY);
            } else {
                interpolate(k->size, end - t, (at - t) / (end - t), X, dX, Y, dY, Z, dZ);
                read_group(k, b, k->due[g], g, at, Z, dZ);
            }
        }
}

/* the same up to the start, X at the first sample */
static void read_start(Work *k, integer b, const double *X) {
    const Run *r = k->r;
    const double *delay = r->group_delay + b * r->groups;
    double *Z = k->stage[6], *dZ = k->stage[7];
    for (integer g = 0; g < r->groups && r->out; g++)
        for (; k->due[g] < r->samples && r->time[k->due[g]] - delay[g] <= r->time[0]; k->due[g]++) {
            double at = r->time[k->due[g]] - delay[g];
            extrapolate(k, r->time[0] - at, X, Z, dZ);
            read_group(k, b, k->due[g], g, at, Z, dZ);
        }
}

/* sensors whose clock is behind read what comes after the last sample: the system moves on as it did there */
static void read_end(Work *k, integer b, const double *X) {
    const Run *r = k->r;
    const double *delay = r->group_delay + b * r->groups, last = r->time[r->samples - 1];
    double *Z = k->stage[6], *dZ = k->stage[7];
    for (integer g = 0; g < r->groups && r->out; g++)
        for (; k->due[g] < r->samples; k->due[g]++) {
            double at = r->time[k->due[g]] - delay[g];
            extrapolate(k, last - at, X, Z, dZ);
            read_group(k, b, k->due[g], g, at, Z, dZ);
        }
}
