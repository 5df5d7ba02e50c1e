/* The batch: every row from its start through all samples. */

static integer first_not_finite(const double *X, integer size) {
    for (integer i = 0; i < size; i++)
        if (!isfinite(X[i])) return i;
    return -1;
}

/* all memory of a run, in two blocks; 0 if there is none */
static int allocate(Work *k, const Run *r, double **reals, integer **integers) {
    integer x = r->states, s = r->columns, n = r->inputs, size = x * (1 + s), sizes[6] = {0};
    if (r->A.start) sizes[0] = r->A.start[x], sizes[1] = r->B.start[n];
    if (s) {
        sizes[2] = r->P.start[r->parameters], sizes[3] = r->C.start[x];
        sizes[4] = r->D.start[n], sizes[5] = r->Q.start[r->parameters];
    }
    integer band = r->method ? x * (2 * r->lower + r->upper + 1) : 0;
    integer count = 11 * size + 4 * n + r->sensors * (s + 2) + r->sz_w + band + 2 * sizes[0] + x;
    for (int i = 1; i < 6; i++) count += sizes[i];
    double *next = *reals = malloc(sizeof(double) * (size_t)(count + 8));
    integer *free_integers = *integers = calloc((size_t)(r->sz_iw + n + r->groups + x + 1), sizeof(integer));
    if (!next || !free_integers) return 0;
    *k = (Work){.r = r, .size = size};
#define TAKE(what, amount) k->what = next, next += (amount)
    for (int i = 0; i < 8; i++) { TAKE(stage[i], size); }
    for (int i = 0; i < 3; i++) { TAKE(node[i], size); }
    TAKE(u, n); TAKE(du, n); TAKE(rise, n); TAKE(rise_in_step, n);
    TAKE(y, r->sensors * (s + 2)); TAKE(w, r->sz_w); TAKE(band, band); TAKE(known_A, sizes[0]); TAKE(step_error, x);
    TAKE(A, sizes[0]); TAKE(B, sizes[1]); TAKE(P, sizes[2]); TAKE(C, sizes[3]); TAKE(D, sizes[4]); TAKE(Q, sizes[5]);
#undef TAKE
    k->iw = free_integers, k->interval = k->iw + r->sz_iw, k->due = k->interval + n, k->pivot = k->due + r->groups;
    return 1;
}

/* from one sample to the next in equal steps; node[0] and node[1] are state and rate, before and after */
static void run_interval(Work *k, integer b, integer j) {
    const Run *r = k->r;
    double begin = r->time[j], span = r->time[j + 1] - begin;
    integer steps = r->steps[j];
    double h = span / (double)steps;
    for (integer i = 0; i < steps && !*r->stop; i++) {
        double t = begin + (double)i * h, end = i + 1 == steps ? r->time[j + 1] : begin + (double)(i + 1) * h;
        double *X = k->node[0], *dX = k->node[1], *next = k->node[2], *next_rate = k->stage[0];
        (r->method ? implicit_step : explicit_step)(k, t, h, end, X, dX, next);
        set_rate(k, end, next, next_rate);
        if (r->error) add_error(k, i, h, X, dX, next, next_rate);
        read_step(k, b, t, end, X, dX, next, next_rate);
        k->node[0] = next, k->node[1] = next_rate, k->node[2] = X, k->stage[0] = dX;
    }
}

static void run_row(Work *k, integer b) {
    const Run *r = k->r;
    integer x = r->states, s = r->columns, n = r->inputs, T = r->samples;
    double *X = k->node[0];
    k->constant = r->constant + b * r->constants, k->delay = r->input_delay + b * n;
    memcpy(X, r->start + b * x, sizeof(double) * (size_t)x);
    if (s) memcpy(X + x, r->start_derivative, sizeof(double) * (size_t)(x * s));
    if (r->state) memcpy(r->state + b * T * x, X, sizeof(double) * (size_t)x);
    memset(k->due, 0, sizeof(integer) * (size_t)r->groups);
    for (integer i = 0; i < n; i++) k->interval[i] = -1;
    k->time_of_inputs = k->known_h = NAN;
    memset(k->step_error, 0, sizeof(double) * (size_t)x);
    r->failed[2 * b] = r->failed[2 * b + 1] = -1;
    set_rate(k, r->time[0], X, k->node[1]);
    read_start(k, b, X);
    for (integer j = 0; j + 1 < T && !*r->stop; j++) {
        run_interval(k, b, j);
        X = k->node[0];
        if (r->error) write_error(k, b, j, X);
        integer bad = first_not_finite(X, k->size);
        if (bad >= 0) {
            r->failed[2 * b] = j + 1, r->failed[2 * b + 1] = bad < x ? bad : (bad - x) / (s ? s : 1);
            return;
        }
        if (r->state) memcpy(r->state + (b * T + j + 1) * x, X, sizeof(double) * (size_t)x);
    }
    if (!*r->stop) read_end(k, b, X);
}

/* 1 without memory */
int run(const Run *r) {
    Work k;
    double *reals = 0;
    integer *integers = 0;
    int done = allocate(&k, r, &reals, &integers);
    for (integer b = r->first_row; done && b < r->end_row && !*r->stop; b++) run_row(&k, b);
    free(reals);
    free(integers);
    return !done;
}
