/* A sampled controller for a powertrain test bed: its law, written by rigmatch, and its supervision.
 *
 * Nothing is allocated, nothing recurses, every loop has a fixed end; no library but the mathematics of C is used.
 * controller.h says how to call it. Matrices stand in controller_data.h row by row without their zeros. */
#include "controller.h"

#include <math.h>
#include <string.h>

#include "controller_data.h"

#define STATES CONTROLLER_STATES
#define READINGS CONTROLLER_READINGS
#define KNOWN CONTROLLER_KNOWN
#define DYNAMOMETERS CONTROLLER_DYNAMOMETERS
#define VEHICLE CONTROLLER_VEHICLE_STATES
#define LOCKED CONTROLLER_LOCKED_STATES

/* what a row of the law is multiplied with, one after the other */
enum {
    AT_STATE = 0,
    AT_READINGS = STATES,
    AT_KNOWN = AT_READINGS + READINGS,
    AT_SENT = AT_KNOWN + CONTROLLER_ACTING,
    WIDTH = AT_SENT + DYNAMOMETERS
};

static controller_real row(const controller_matrix *m, int32_t i, const controller_real *z)
{
    controller_real sum = (controller_real)0.0;
    for (uint32_t k = m->start[i]; k < m->start[i + 1]; k++) {
        sum += m->value[k] * z[m->column[k]];
    }
    return sum;
}

/* the same between the matrices of two neighbouring speeds */
static controller_real between(const controller_matrix *m, int32_t at, controller_real share, int32_t i, const controller_real *z)
{
    const controller_real low = row(&m[at], i, z);
    controller_real found = low;
    if (share > (controller_real)0.0) {
        found = low + (share * (row(&m[at + 1], i, z) - low));
    }
    return found;
}

static controller_real within(controller_real value, controller_real low, controller_real high)
{
    controller_real cut = value;
    if (cut > high) {
        cut = high;
    }
    if (cut < low) {
        cut = low;
    }
    return cut;
}

static bool all_finite(const controller_real *value, int32_t count)
{
    bool finite = true;
    for (int32_t i = 0; i < count; i++) {
        if (!isfinite(value[i])) {
            finite = false;
        }
    }
    return finite;
}

/* the command that the readings of this sample show, straight between past ones */
static controller_real acting_command(const controller *c, int32_t j)
{
    const int32_t at = SENT_DELAY[j];
    return c->past_sent[at][j] + (SENT_PART[j] * (c->past_sent[at + 1][j] - c->past_sent[at][j]));
}

/* balance of a rotor: the torque of its air gap by what is measured */
static double air_torque(int32_t j, double rate, double speed, double flange)
{
    return ((double)ROTOR_INERTIA[j] * rate) + ((double)ROTOR_DRAG[j] * speed) - ((double)ROTOR_SIGN[j] * flange);
}

static bool is_holdable(int32_t fault)
{
    return (fault == CONTROLLER_OVERSPEED) || (fault == CONTROLLER_TORQUE_GONE) || (fault == CONTROLLER_UNEXPECTED) ||
           (fault == CONTROLLER_NOT_DELIVERED);
}

void controller_init(controller *c)
{
    c->settings = CONTROLLER_DEFAULTS;
    controller_reset(c);
}

void controller_reset(controller *c)
{
    const controller_settings kept = c->settings;
    (void)memset(c, 0, sizeof *c);
    c->settings = kept;
    c->fallback = CONTROLLER_ZERO_TORQUE;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        c->tracker[j].wait = TRACK_SETTLING;
        for (int32_t q = 0; q < 4; q++) {
            c->tracker[j].variance[q] = 1.0 / TRACK_PRIOR[j][q];
        }
    }
}

static bool is_frozen(controller *c, const controller_input *in)
{
    bool same = true;
    bool turning = false;
    for (int32_t i = 0; i < READINGS; i++) {
        if (in->reading[i] != c->last[i]) {
            same = false;
        }
    }
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        if (fabs((double)in->reading[SPEED_READING[j]]) > CONTROLLER_TURNING) {
            turning = true;
        }
    }
    c->unchanged = (same && turning) ? (c->unchanged + 1) : 0;
    return (c->settings.frozen_samples > 0) && (c->unchanged >= c->settings.frozen_samples);
}

static bool is_lifeless(controller *c, const controller_input *in)
{
    const bool same = (c->has_life != 0) && (in->life == c->life);
    c->lifeless = same ? (c->lifeless + 1) : 0;
    c->life = in->life;
    c->has_life = 1;
    return (c->settings.life_samples > 0) && (c->lifeless >= c->settings.life_samples);
}

static bool is_too_fast(const controller *c, const controller_input *in)
{
    bool fast = false;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const controller_real limit =
            (c->mode == CONTROLLER_CHANNEL_CHECK) ? c->settings.check_speed[j] : c->settings.speed_limit[j];
        if (fabs((double)in->reading[SPEED_READING[j]]) > (double)limit) {
            fast = true;
        }
    }
    return fast;
}

/* torque of a dynamometer's flange; 0 without a flange, which never seems lost */
static controller_real flange_torque(const controller_input *in, int32_t j)
{
    return (TORQUE_READING[j] < 0) ? (controller_real)0.0 : in->reading[TORQUE_READING[j]];
}

/* a torque is gone at once, or what a break leaves of it swings about zero */
static bool has_lost_torque(controller *c, const controller_input *in, const controller_input *seen)
{
    bool lost = false;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const double least = (double)c->settings.lost_torque[j];
        /* a torque that is gone is no wrong reading: it counts as it is read */
        const double read = flange_torque(in, j);
        const double now = isfinite(read) ? read : (double)flange_torque(seen, j);
        double before = 0.0;
        double earlier = 0.0;
        double sum = now;
        for (int32_t n = 0; n < CONTROLLER_JUDGED; n++) {
            const double past = (double)c->past_torque[n][j];
            if (n < CONTROLLER_REMEMBERED) {
                before = fmax(before, fabs(past));
            }
            if (n < (CONTROLLER_AVERAGED - 1)) {
                sum += past;
            } else {
                earlier = fmax(earlier, fabs(past));
            }
        }
        const bool at_once = (before > least) && (fabs(now) < (CONTROLLER_GONE * before));
        const bool about_zero = (earlier > least) && (fabs(sum) < (CONTROLLER_AVERAGED * CONTROLLER_GONE * earlier));
        c->gone[j] = (at_once || about_zero) ? 1 : 0;
        if (c->gone[j] != 0) {
            lost = true;
        }
    }
    return lost;
}

/* what readings are off from what the controller's model expects, newest sample first */
static void note_deviation(controller *c, const controller_input *in)
{
    for (int32_t i = (CONTROLLER_WATCHED * READINGS) - 1; i >= READINGS; i--) {
        c->deviation[i] = c->deviation[i - READINGS];
    }
    for (int32_t i = 0; i < READINGS; i++) {
        c->deviation[i] = in->reading[i] - c->reading_start[i] - row(&EXPECTED, i, c->state);
    }
}

/* for how many samples a shaft has carried enough torque with one sign: counted down where that is negative */
static int32_t carried_for(int32_t before, double carried, double least)
{
    int32_t samples = 0;
    if (carried > least) {
        samples = (before > 0) ? (before + 1) : 1;
    }
    if (carried < -least) {
        samples = (before < 0) ? (before - 1) : -1;
    }
    if (samples > CONTROLLER_CARRIED_SAMPLES) {
        samples = CONTROLLER_CARRIED_SAMPLES;
    }
    if (samples < -CONTROLLER_CARRIED_SAMPLES) {
        samples = -CONTROLLER_CARRIED_SAMPLES;
    }
    return samples;
}

/* a watched shaft seems to have lost the torque that it carried before the watched samples, several times in a row */
static bool has_opened(controller *c)
{
    bool opened = false;
    for (int32_t i = 0; i < CONTROLLER_SHAFTS; i++) {
        const double carried = (double)row(&CARRIED, i, c->past_torque[CONTROLLER_WATCHED - 1]);
        const double size = fabs(carried);
        const double lost = (double)row(&LOST, i, c->deviation) * ((carried < 0.0) ? -1.0 : 1.0);
        c->carried_for[i] = carried_for(c->carried_for[i], carried, (double)c->settings.opened_torque[i]);
        const bool loaded = (c->carried_for[i] == CONTROLLER_CARRIED_SAMPLES) ||
                            (c->carried_for[i] == -CONTROLLER_CARRIED_SAMPLES);
        const bool now = loaded && (lost > ((double)c->settings.opened_share * size)) &&
                         (lost < (CONTROLLER_LARGEST_SHARE * size));
        c->seems_open[i] = now ? (c->seems_open[i] + 1) : 0;
        if (c->seems_open[i] >= CONTROLLER_OPENED_IN_A_ROW) {
            opened = true;
            for (uint32_t k = CARRIED.start[i]; k < CARRIED.start[i + 1]; k++) {
                c->gone[CARRIED.column[k]] = 1; /* the rotors that it loaded */
            }
        }
    }
    return opened;
}

/* what the controller's model expects of a reading */
static controller_real expected_reading(const controller *c, int32_t i)
{
    return c->reading_start[i] + row(&EXPECTED, i, c->state);
}

/* refuses readings that are not finite or far from what is expected, at once or in the mean; seen gets what is used */
static void refuse_readings(controller *c, const controller_input *in, controller_input *seen)
{
    for (int32_t i = 0; i < READINGS; i++) {
        const controller_real expected = expected_reading(c, i);
        const bool finite = isfinite(in->reading[i]);
        const controller_real off = finite ? (in->reading[i] - expected) : (controller_real)0.0;
        if (finite) {
            /* a jump that is over leaves the mean soon */
            const controller_real counted = within(off, -c->settings.unexpected[i], c->settings.unexpected[i]);
            c->off_mean[i] += (counted - c->off_mean[i]) / (controller_real)CONTROLLER_MEAN_OF_OFF;
        }
        if (c->settings.ride_samples > 0) {
            const double most = (double)c->settings.unexpected[i];
            const bool far = (fabs((double)off) > most) || (fabs((double)c->off_mean[i]) > (CONTROLLER_MEAN_SHARE * most));
            c->refused[i] = (far || !finite) ? 1 : 0;
            c->lost[i] = (c->refused[i] != 0) ? (c->lost[i] + 1) : 0;
            if (c->refused[i] != 0) {
                seen->reading[i] = expected;
            }
        }
    }
}

/* speeds of rotors whose sensors are not trusted, by the others; not finite where these do not determine them */
static void replace_speeds(const controller *c, controller_input *seen)
{
    controller_real other[READINGS];
    for (int32_t i = 0; i < READINGS; i++) {
        other[i] = (c->distrusted[i] != 0) ? (controller_real)NAN : seen->reading[i];
        if (c->distrusted[i] != 0) {
            seen->reading[i] = (controller_real)0.0; /* speed hold does not use it */
        }
    }
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        if (c->distrusted[SPEED_READING[j]] != 0) {
            const bool determined = BY_OTHERS.start[j + 1] > BY_OTHERS.start[j];
            seen->reading[SPEED_READING[j]] = determined ? row(&BY_OTHERS, j, other) : (controller_real)NAN;
        }
    }
}

/* a rotor's speed that is furthest from what the others say, and further than is allowed, is not trusted any more, nor one
 * that was refused where the others were not */
static void distrust_contradicted(controller *c, const controller_input *seen)
{
    int32_t furthest = -1;
    controller_real most = (controller_real)1.0;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const int32_t at = SPEED_READING[j];
        if (BY_OTHERS.start[j + 1] > BY_OTHERS.start[j]) {
            const controller_real apart = seen->reading[at] - row(&BY_OTHERS, j, seen->reading);
            const controller_real share = (controller_real)fabs((double)apart) / c->settings.unexpected[at];
            if (share > most) {
                most = share;
                furthest = at;
            }
        }
    }
    if (furthest >= 0) {
        c->distrusted[furthest] = 1;
    }
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        bool right = BY_OTHERS.start[j + 1] > BY_OTHERS.start[j];
        for (uint32_t k = BY_OTHERS.start[j]; k < BY_OTHERS.start[j + 1]; k++) {
            right = right && (c->refused[BY_OTHERS.column[k]] == 0);
        }
        if (right && (c->refused[SPEED_READING[j]] != 0)) {
            c->distrusted[SPEED_READING[j]] = 1;
        }
    }
}

/* two readings at once that are not what is expected, or one for too long */
static int32_t judge_unexpected(controller *c, const controller_input *in, controller_input *seen)
{
    int32_t fault = CONTROLLER_NO_FAULT;
    int32_t refused = 0;
    int32_t longest = -1;
    bool off = false;
    bool too_long = false;
    for (int32_t i = 0; i < READINGS; i++) {
        const bool far = fabs((double)c->deviation[i]) > (double)c->settings.unexpected[i];
        off = off || far;
        refused += c->refused[i];
        if ((far || (c->refused[i] != 0)) && ((longest < 0) || (c->lost[i] > c->lost[longest]))) {
            longest = i;
        }
        if ((c->settings.ride_samples > 0) && (c->lost[i] >= c->settings.ride_samples)) {
            too_long = true;
        }
    }
    c->surprised = ((refused > 1) || off) ? (c->surprised + 1) : 0;
    if (longest >= 0) {
        c->sensor = longest;
    }
    if (c->surprised >= CONTROLLER_IN_A_ROW) {
        /* the model does not hold: what is read counts, but for speeds that right ones determine or contradict */
        for (int32_t i = 0; i < READINGS; i++) {
            const bool finite = isfinite(in->reading[i]);
            c->distrusted[i] = ((c->refused[i] != 0) && !finite) ? 1 : 0;
            if (finite) {
                seen->reading[i] = in->reading[i];
            }
        }
        distrust_contradicted(c, seen);
        replace_speeds(c, seen);
        fault = all_finite(seen->reading, READINGS) ? CONTROLLER_UNEXPECTED : CONTROLLER_NOT_FINITE;
    } else if (too_long) {
        (void)memcpy(c->distrusted, c->refused, sizeof c->distrusted);
        for (int32_t j = 0; j < DYNAMOMETERS; j++) { /* a false speed contradicts the torque: hold neither of them true */
            const bool determined = BY_OTHERS.start[j + 1] > BY_OTHERS.start[j];
            if (determined && (TORQUE_READING[j] >= 0) && (c->refused[TORQUE_READING[j]] != 0)) {
                c->distrusted[SPEED_READING[j]] = 1;
            }
        }
        replace_speeds(c, seen);
        fault = all_finite(seen->reading, READINGS) ? CONTROLLER_UNEXPECTED : CONTROLLER_NOT_FINITE;
    } else {
        /* nothing, or one reading that is refused for a short time */
    }
    return fault;
}

/* what the emulated vehicle is told of its road and its mass is possible */
static bool is_road(const controller *c)
{
    bool possible = true;
#if CONTROLLER_VEHICLE_STATES > 0
    possible = all_finite(c->settings.friction, CONTROLLER_TYRES) && isfinite(c->settings.grade) &&
               isfinite(c->settings.mass) && (c->settings.mass > (controller_real)0.0);
    for (int32_t i = 0; i < CONTROLLER_TYRES; i++) {
        if (!(c->settings.friction[i] > (controller_real)0.0)) {
            possible = false;
        }
    }
#else
    (void)c;
#endif
    return possible;
}

static bool any_distrusted(const controller *c)
{
    bool any = false;
    for (int32_t i = 0; i < READINGS; i++) {
        any = any || (c->distrusted[i] != 0);
    }
    return any;
}

/* what the air gap delivers: torque of the flange and the rotor's own inertia against what was commanded */
static bool is_undelivered(controller *c)
{
    bool undelivered = false;
    const controller_real time = (controller_real)CONTROLLER_DELIVERY;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const double rate = (double)(c->rotor_last[j] - c->rotor_filtered[j]) / (double)time;
        const double delivered = air_torque(j, rate, (double)c->rotor_filtered[j], (double)c->flange_filtered[j]);
        const double off = fabs(delivered - (double)c->sent_filtered[j]);
        const double size = fabs((double)c->sent_filtered[j]);
        const bool judged = (ROTOR_INERTIA[j] > (controller_real)0.0) && (size > (double)c->settings.lost_torque[j]) &&
                            (c->settings.undelivered_share > (controller_real)0.0);
        const bool now = judged && (off > ((double)c->settings.undelivered_share * size));
        c->undelivered_for[j] = now ? (c->undelivered_for[j] + 1) : 0;
        if (c->undelivered_for[j] >= CONTROLLER_UNDELIVERED_SAMPLES) {
            c->sensor = TORQUE_READING[j];
            undelivered = true;
        }
    }
    return undelivered;
}

/* what was commanded, as it acts now, what the flange says and how fast the rotor turns, alike filtered */
static void follow_delivery(controller *c, const controller_input *in)
{
    const controller_real share = (controller_real)(CONTROLLER_SAMPLE_TIME / CONTROLLER_DELIVERY);
    for (int32_t n = CONTROLLER_SENT_KEPT - 1; n > 0; n--) {
        (void)memcpy(c->past_sent[n], c->past_sent[n - 1], sizeof c->past_sent[n]);
    }
    (void)memcpy(c->past_sent[0], c->sent, sizeof c->past_sent[0]);
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const controller_real acting = acting_command(c, j);
        const controller_real now = in->reading[SPEED_READING[j]];
        if (c->has_delivery == 0) {
            c->sent_filtered[j] = acting;
            c->flange_filtered[j] = flange_torque(in, j);
            c->rotor_filtered[j] = now;
        }
        c->sent_filtered[j] += share * (acting - c->sent_filtered[j]);
        c->flange_filtered[j] += share * (flange_torque(in, j) - c->flange_filtered[j]);
        c->rotor_filtered[j] += share * (now - c->rotor_filtered[j]);
        c->rotor_last[j] = now;
    }
    c->has_delivery = 1;
}

/* inverse of a matrix of four, by Gauss and Jordan with exchanged rows */
static void inverse_of(const double m[4][4], double found[4][4])
{
    double left[4][4];
    (void)memcpy(left, m, sizeof left);
    for (int32_t i = 0; i < 4; i++) {
        for (int32_t k = 0; k < 4; k++) {
            found[i][k] = (i == k) ? 1.0 : 0.0;
        }
    }
    for (int32_t n = 0; n < 4; n++) {
        int32_t largest = n;
        for (int32_t i = n + 1; i < 4; i++) {
            if (fabs(left[i][n]) > fabs(left[largest][n])) {
                largest = i;
            }
        }
        for (int32_t k = 0; k < 4; k++) {
            const double moved = left[n][k];
            const double also = found[n][k];
            left[n][k] = left[largest][k];
            left[largest][k] = moved;
            found[n][k] = found[largest][k];
            found[largest][k] = also;
        }
        const double pivot = left[n][n];
        for (int32_t k = 0; k < 4; k++) {
            left[n][k] /= pivot;
            found[n][k] /= pivot;
        }
        for (int32_t i = 0; i < 4; i++) {
            const double part = left[i][n];
            if (i != n) {
                for (int32_t k = 0; k < 4; k++) {
                    left[i][k] -= part * left[n][k];
                    found[i][k] -= part * found[n][k];
                }
            }
        }
    }
}

/* what has drifted beyond its limit: from what the match was made for, or from the first sure value of this run */
static void judge_drift(controller_tracker *t, int32_t j)
{
    static const int32_t at[3] = {0, 1, 2}; /* gain, delay, zero */
    static const int32_t bit[3] = {1, 4, 2};
    const int32_t before = t->drifted;
    t->drifted = 0;
    for (int32_t n = 0; n < 3; n++) {
        const int32_t q = at[n];
        bool off = (before & bit[n]) != 0; /* stays as it was where nothing is sure */
        if ((t->blocks >= TRACK_LEAST_BLOCKS) && (sqrt(t->variance[q]) <= (TRACK_SURE * TRACK_DRIFT[j][n]))) {
            if (t->has_first[n] == 0) {
                t->has_first[n] = 1;
                t->first_found[n] = t->found[q];
                t->first_variance[n] = t->variance[q];
                t->first_bent[n] = t->bent[q];
            }
            const double certainty = off ? 0.0 : TRACK_CERTAINTY; /* a warning ends within the limit */
            const double turned = t->bent[q] - t->first_bent[n];
            const double apart = sqrt(t->variance[q] + t->first_variance[n] + (turned * turned));
            off = fabs(t->found[q] - t->first_found[n]) > (TRACK_DRIFT[j][n] + (certainty * apart));
            if (n < 2) {
                const double total = sqrt(t->variance[q] + (t->bent[q] * t->bent[q]));
                off = off || (fabs(t->found[q]) > (TRACK_MOST[j][n] + (certainty * total)));
            }
        }
        if (off) {
            t->drifted += bit[n];
        }
    }
}

/* values by instrumental variables, with the scores of the blocks as uncertainty */
static void estimate(controller_tracker *t, int32_t j, const double block[4][6], const double inverse[4][4])
{
    double score[4];
    double spread[4][4];
    bool known = true;
    for (int32_t i = 0; i < 4; i++) {
        t->found[i] = 0.0;
        t->bent[i] = 0.0;
        for (int32_t k = 0; k < 4; k++) {
            t->found[i] += inverse[i][k] * t->sum[k][4];
            t->bent[i] += TRACK_INERTIA * inverse[i][k] * t->sum[k][5];
        }
    }
    for (int32_t i = 0; i < 4; i++) {
        score[i] = block[i][4];
        for (int32_t k = 0; k < 4; k++) {
            score[i] -= block[i][k] * t->found[k];
        }
    }
    for (int32_t i = 0; i < 4; i++) {
        for (int32_t k = 0; k < 4; k++) {
            t->scores[i][k] = (TRACK_KEPT * TRACK_KEPT * t->scores[i][k]) + (score[i] * score[k]);
            spread[i][k] = t->scores[i][k] + ((i == k) ? TRACK_PRIOR[j][i] : 0.0);
        }
    }
    for (int32_t n = 0; n < 4; n++) {
        t->variance[n] = 0.0;
        for (int32_t i = 0; i < 4; i++) {
            for (int32_t k = 0; k < 4; k++) {
                t->variance[n] += inverse[n][i] * spread[i][k] * inverse[n][k];
            }
        }
        known = known && (inverse[n][n] > 0.0) && ((t->variance[n] * TRACK_PRIOR[j][n]) <= 1.0);
    }
    for (int32_t n = 0; n < 4; n++) {
        if (!known) { /* the bed has hardly moved */
            t->found[n] = 0.0;
            t->bent[n] = 0.0;
            t->variance[n] = 1.0 / TRACK_PRIOR[j][n];
        }
        const bool begins = !known || (t->blocks < TRACK_LEAST_BLOCKS);
        t->slow[n] += (begins ? 1.0 : (1.0 - TRACK_KEPT)) * (t->found[n] - t->slow[n]);
    }
}

/* a block is full: estimate and judge anew */
static void close_block(controller_tracker *t, int32_t j)
{
    double m[4][4];
    double inverse[4][4];
    double block[4][6];
    bool finite = true;
    for (int32_t i = 0; i < 4; i++) {
        for (int32_t k = 0; k < 6; k++) {
            t->sum[i][k] = (TRACK_KEPT * t->sum[i][k]) + t->block[i][k];
        }
        for (int32_t k = 0; k < 4; k++) {
            m[i][k] = t->sum[i][k] + ((i == k) ? TRACK_PRIOR[j][i] : 0.0);
        }
    }
    (void)memcpy(block, t->block, sizeof block);
    (void)memset(t->block, 0, sizeof t->block);
    t->counted = 0;
    inverse_of((const double (*)[4])m, inverse);
    for (int32_t i = 0; i < 4; i++) {
        for (int32_t k = 0; k < 4; k++) {
            finite = finite && isfinite(inverse[i][k]);
        }
    }
    if (finite) {
        estimate(t, j, (const double (*)[6])block, (const double (*)[4])inverse);
        t->blocks += (t->blocks < TRACK_LEAST_BLOCKS) ? 1 : 0;
        judge_drift(t, j);
    } else { /* readings beyond all bounds: they are forgotten */
        (void)memset(t->sum, 0, sizeof t->sum);
        (void)memset(t->scores, 0, sizeof t->scores);
        t->blocks = 0;
    }
}

/* one sample of what is tracked: the command that acts, flange torque and speed; it counts in emulation and motion */
static void track(controller_tracker *t, int32_t j, const double now[3], bool counts)
{
    static const double share[2] = {TRACK_SMOOTHING, TRACK_SECOND_SMOOTHING};
    double slope[3];
    for (int32_t n = 0; n < 3; n++) {
        if (t->begun == 0) {
            t->smooth[0][n] = now[n];
            t->smooth[1][n] = now[n];
        }
        const double before = t->smooth[1][n];
        t->smooth[0][n] += share[0] * (now[n] - t->smooth[0][n]);
        t->smooth[1][n] += share[1] * (t->smooth[0][n] - t->smooth[1][n]);
        slope[n] = (t->smooth[1][n] - before) / (double)CONTROLLER_SAMPLE_TIME;
    }
    t->begun = 1;
    const double speed = t->smooth[1][2];
    const double command = t->smooth[1][0] - (ROTOR_LATE[j] * slope[0]);
    const double flange = t->smooth[1][1] - (ROTOR_LATE[j] * slope[1]);
    const double z[6] = {command, -slope[0], 1.0, -speed, air_torque(j, slope[2], speed, flange) - command,
                         (double)ROTOR_INERTIA[j] * slope[2]};
    double instrument[4];
    (void)memcpy(instrument, t->older[t->newest], sizeof instrument);
    (void)memcpy(t->older[t->newest], z, sizeof instrument);
    t->newest = (t->newest + 1) % CONTROLLER_OLDER;
    if (!counts) {
        t->wait = TRACK_SETTLING;
        t->counted = 0;
        (void)memset(t->block, 0, sizeof t->block);
    } else if (t->wait > 0) {
        t->wait--;
    } else {
        for (int32_t i = 0; i < 4; i++) {
            for (int32_t k = 0; k < 6; k++) {
                t->block[i][k] += instrument[i] * z[k];
            }
        }
        t->counted++;
        if (t->counted >= TRACK_BLOCK) {
            close_block(t, j);
        }
    }
}

/* torque gain, flange zero and dead time of every dynamometer whose rotor's balance is known */
static void track_all(controller *c, const controller_input *in)
{
    bool counts = (c->mode == CONTROLLER_EMULATION) && (c->caught_up == 0);
    for (int32_t i = 0; i < READINGS; i++) {
        counts = counts && (c->refused[i] == 0);
    }
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const double now[3] = {(double)acting_command(c, j), (double)flange_torque(in, j),
                               (double)in->reading[SPEED_READING[j]]};
        if (ROTOR_INERTIA[j] > (controller_real)0.0) {
            track(&c->tracker[j], j, now, counts && (fabs(now[2]) > (double)CONTROLLER_TURNING));
        }
    }
}

/* standard uncertainty of a value: noise, what the inertia makes of it, and by how much it lags behind a drift */
static double tracked_uncertainty(const controller_tracker *t, int32_t n)
{
    const double late = t->found[n] - t->slow[n];
    return sqrt(t->variance[n] + (t->bent[n] * t->bent[n]) + (late * late));
}

static void show_tracked(const controller *c, controller_output *out)
{
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const controller_tracker *t = &c->tracker[j];
        const double sign = (double)ROTOR_SIGN[j];
        out->tracked_gain[j] = (controller_real)(1.0 + t->found[0]);
        out->tracked_delay[j] = (controller_real)t->found[1];
        out->tracked_zero[j] = (controller_real)(-t->found[2] / sign);
        out->gain_uncertainty[j] = (controller_real)tracked_uncertainty(t, 0);
        out->delay_uncertainty[j] = (controller_real)tracked_uncertainty(t, 1);
        out->zero_uncertainty[j] = (controller_real)(tracked_uncertainty(t, 2) / fabs(sign));
        out->drifted[j] = t->drifted;
    }
}

/* the fault of this sample; seen are the readings as they are used */
static int32_t check(controller *c, const controller_input *in, controller_input *seen)
{
    int32_t fault = CONTROLLER_NO_FAULT;
    const bool lifeless = is_lifeless(c, in);
    (void)memset(c->refused, 0, sizeof c->refused);
    if (!all_finite(in->known, KNOWN) || !all_finite(in->hold_speed, DYNAMOMETERS) ||
        !all_finite(in->added_torque, DYNAMOMETERS) || !is_road(c)) {
        fault = CONTROLLER_NOT_FINITE;
    } else {
        if (c->mode == CONTROLLER_EMULATION) {
            refuse_readings(c, in, seen);
        } else if (any_distrusted(c)) {
            replace_speeds(c, seen);
        } else {
            /* readings are used as they are */
        }
        if (!all_finite(seen->reading, READINGS)) {
            for (int32_t i = READINGS - 1; i >= 0; i--) {
                if (!isfinite(seen->reading[i])) {
                    c->sensor = i;
                }
            }
            fault = CONTROLLER_NOT_FINITE;
        } else if (lifeless) {
            fault = CONTROLLER_MISSING;
        } else if (is_frozen(c, in)) {
            fault = CONTROLLER_FROZEN;
        } else if (is_too_fast(c, seen)) {
            fault = CONTROLLER_OVERSPEED;
        } else if (c->mode != CONTROLLER_EMULATION) {
            c->surprised = 0;
        } else {
#if CONTROLLER_FOREIGN > 0
            const bool vehicle = all_finite(in->cut_speed, DYNAMOMETERS);
#else
            const bool vehicle = true;
#endif
            note_deviation(c, seen);
            const bool shifting = in->shifting != 0;
            const bool lost = !shifting && has_lost_torque(c, in, seen);
            const bool opened = !shifting && has_opened(c);
            if (shifting) { /* a clutch may open */
                (void)memset(c->gone, 0, sizeof c->gone);
                (void)memset(c->carried_for, 0, sizeof c->carried_for);
                (void)memset(c->seems_open, 0, sizeof c->seems_open);
            }
            if (!vehicle) {
                c->sensor = -1; /* what the bed reads is right */
                fault = CONTROLLER_UNEXPECTED;
            } else if (lost || opened) {
                fault = CONTROLLER_TORQUE_GONE;
            } else {
                fault = judge_unexpected(c, in, seen);
            }
            if ((fault == CONTROLLER_NO_FAULT) && is_undelivered(c)) {
                fault = CONTROLLER_NOT_DELIVERED;
            }
        }
    }
    return fault;
}

/* the speed that is held: after a fault the one at that moment */
static controller_real wanted_speed(const controller *c, const controller_input *in, int32_t j)
{
    return (c->fault != CONTROLLER_NO_FAULT) ? c->held[j] : in->hold_speed[j];
}

static void average_of(controller_real *mean, controller_real *slow, const controller_real *value, int32_t count, int32_t samples)
{
    for (int32_t i = 0; i < count; i++) {
        mean[i] += (value[i] - mean[i]) / (controller_real)samples;
        slow[i] += (mean[i] - slow[i]) / (controller_real)samples;
    }
}

/* twice a mean less the mean of the mean: no lag behind an even change */
static void start_of(controller_real *start, const controller_real *mean, const controller_real *slow, int32_t count)
{
    for (int32_t i = 0; i < count; i++) {
        start[i] = ((controller_real)2.0 * mean[i]) - slow[i];
    }
}

/* what an emulation begins from is averaged before it, so that the noise of one sample is no offset of the emulation */
static void average(controller *c, const controller_input *in)
{
    if (c->averaged < CONTROLLER_MEAN_SAMPLES) {
        c->averaged++;
    }
    average_of(c->mean, c->slow, in->reading, READINGS, c->averaged);
    average_of(c->known_mean, c->known_slow, in->known, KNOWN, c->averaged);
    average_of(c->sent_mean, c->sent_slow, c->sent, DYNAMOMETERS, c->averaged);
}

#if (CONTROLLER_VEHICLE_STATES > 0) || (CONTROLLER_FOREIGN > 0)
/* where a value stands on a rising grid: number of the lower neighbour and share of the upper one */
static int32_t place(const controller_real *grid, int32_t count, controller_real value, controller_real *share)
{
    int32_t at = 0;
    for (int32_t n = 1; n < (count - 1); n++) {
        if (value >= grid[n]) {
            at = n;
        }
    }
    *share = within((value - grid[at]) / (grid[at + 1] - grid[at]), (controller_real)0.0, (controller_real)1.0);
    return at;
}

/* mean speed of the rotors as they turn forwards */
static controller_real mean_rotor(const controller_real *reading)
{
    controller_real rotor = (controller_real)0.0;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        rotor += ROTOR_SHARE[j] * reading[SPEED_READING[j]];
    }
    return rotor;
}

/* share of the lowest speed of a grid above 0 that a speed is, 1 beyond it */
static controller_real share_of(controller_real speed, controller_real lowest)
{
    return (lowest > (controller_real)0.0) ? within(speed / lowest, (controller_real)-1.0, (controller_real)1.0)
                                           : (controller_real)1.0;
}
#endif

#if CONTROLLER_FOREIGN > 0
/* a vehicle that is stepped outside: where its emulation begins */
static void begin_foreign(controller *c, const controller_input *in)
{
    controller_real share;
    const controller_real rotor = mean_rotor(c->reading_start);
    const int32_t at = place(ROTOR_SPEED, CONTROLLER_SPEEDS, rotor, &share);
    c->body_start =
        share_of(rotor, ROTOR_SPEED[0]) * (STEADY_BODY[at] + (share * (STEADY_BODY[at + 1] - STEADY_BODY[at])));
    (void)memset(c->load, 0, sizeof c->load);
    (void)memset(c->expected_wheel, 0, sizeof c->expected_wheel);
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        c->wheel_start[j] = c->reading_start[SPEED_READING[j]] / OVER[j];
        c->at_cut[j] = row(&CUT_BY_READING, j, c->reading_start) + row(&CUT_BY_COMMAND, j, c->sent_start);
        c->load[j] = c->at_cut[j] - c->held_cut[j]; /* it needs the one to keep its speed, and gets the other */
        c->angle[j] = (controller_real)0.0;
        c->last_wheel[j] = in->cut_speed[j];
        for (int32_t n = 0; n < CONTROLLER_VEHICLE_STEPS; n++) {
            c->past_cut[n][j] = c->held_cut[j];
        }
    }
    c->since_wheel = 0;
}

/* what the vehicle that is stepped outside says of its wheels corrects the design vehicle and its loads */
static void use_wheels(controller *c, const controller_input *in, int32_t at, controller_real share, controller_real *z)
{
    const controller_real h = (controller_real)CONTROLLER_SAMPLE_TIME;
    controller_real off[DYNAMOMETERS];
    bool is_new = false;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        for (int32_t n = 0; n < CONTROLLER_VEHICLE_LATE; n++) {
            c->expected_wheel[n][j] = c->expected_wheel[n + 1][j];
        }
        c->expected_wheel[CONTROLLER_VEHICLE_LATE][j] = row(&WHEEL, j, c->state + OBSERVED);
    }
    c->since_wheel++;
    for (int32_t i = 0; i < CONTROLLER_LOADS; i++) {
        c->load[i] *= (controller_real)CONTROLLER_LOAD_STAYS;
    }
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const controller_real wheel = in->cut_speed[j];
        const controller_real apart = (in->reading[SPEED_READING[j]] / OVER[j]) - wheel;
        const controller_real rolled = (controller_real)fabs((double)wheel) / (controller_real)CONTROLLER_ANGLE_ROLL;
        c->angle[j] = (c->angle[j] + (h * apart)) / ((controller_real)1.0 + (h * rolled));
        off[j] = wheel - (c->angle[j] / (controller_real)CONTROLLER_ANGLE_TIME) - c->wheel_start[j] -
                 c->expected_wheel[0][j];
        is_new = is_new || (c->since_wheel >= CONTROLLER_VEHICLE_STEPS) || (wheel != c->last_wheel[j]);
        c->last_wheel[j] = wheel;
    }
    if (is_new) {
        c->since_wheel = 0;
        for (int32_t i = 0; i < CONTROLLER_DESIGN_STATES; i++) {
            z[OBSERVED + i] += between(BY_WHEEL, at, share, i, off);
        }
        for (int32_t i = 0; i < CONTROLLER_LOADS; i++) {
            c->load[i] += between(BY_WHEEL, at, share, CONTROLLER_DESIGN_STATES + i, off);
        }
        for (int32_t n = 0; n < CONTROLLER_VEHICLE_LATE; n++) {
            for (int32_t j = 0; j < DYNAMOMETERS; j++) {
                c->expected_wheel[n + 1][j] += between(CATCHES, at, share, (n * DYNAMOMETERS) + j, off);
            }
        }
    }
}

/* rates of the design vehicle by its loads, and by torques of its own that act as it moves */
static void loads_of(const controller *c, controller_real body, int32_t at, controller_real share,
                     const controller_real *known, controller_real *found)
{
    controller_real own[CONTROLLER_VEHICLE_INPUTS + 1];
    const controller_real part = share_of(body, SPEED[0]);
    for (int32_t i = 0; i < CONTROLLER_VEHICLE_INPUTS; i++) {
        own[i] = part * known[(KNOWN - CONTROLLER_VEHICLE_INPUTS) + i];
    }
    for (int32_t i = 0; i < CONTROLLER_DESIGN_STATES; i++) {
        found[i] = row(&BY_LOAD, i, c->load) + between(BY_OWN, at, share, i, own);
    }
}

/* torques at the cuts of the vehicle that is stepped outside, for its next step */
static void drive_vehicle(controller *c, const controller_input *in, bool unknown, controller_output *out)
{
    const int32_t samples = (c->averaged < CONTROLLER_MEAN_SAMPLES) ? (c->averaged + 1) : CONTROLLER_MEAN_SAMPLES;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        controller_real torque = (controller_real)0.0;
        if (c->mode == CONTROLLER_EMULATION) {
            for (int32_t n = 0; n < CONTROLLER_VEHICLE_STEPS; n++) {
                torque += c->past_cut[n][j] / (controller_real)CONTROLLER_VEHICLE_STEPS;
            }
        } else if ((c->mode == CONTROLLER_SPEED_HOLD) && !unknown) {
            controller_real slower = (in->reading[SPEED_READING[j]] / OVER[j]) - in->cut_speed[j];
            if (!isfinite(slower)) {
                slower = (controller_real)0.0;
            }
            const controller_real asked = (RUN_IN_PROPORTIONAL[j] * slower) + c->cut_integral[j];
            torque = within(asked, -RUN_IN_LARGEST[j], RUN_IN_LARGEST[j]);
            if (torque == asked) {
                c->cut_integral[j] += RUN_IN_INTEGRAL[j] * (controller_real)CONTROLLER_SAMPLE_TIME * slower;
            }
            c->held_cut[j] += (torque - c->held_cut[j]) / (controller_real)samples;
        } else {
            c->held_cut[j] = (controller_real)0.0;
            c->cut_integral[j] = (controller_real)0.0;
        }
        c->cut_torque[j] = torque;
        out->cut_torque[j] = torque;
    }
}
#endif

#if CONTROLLER_VEHICLE_STATES > 0
/* the vehicle as it runs steadily at the rotors' speed, below the lowest speed of a grid above 0 in proportion */
static void place_vehicle(controller *c, const controller_real *reading)
{
    controller_real share;
    const controller_real rotor = mean_rotor(reading);
    const int32_t at = place(ROTOR_SPEED, CONTROLLER_SPEEDS, rotor, &share);
    const controller_real part = share_of(rotor, ROTOR_SPEED[0]);
    for (int32_t i = 0; i < VEHICLE; i++) {
        c->vehicle[i] = part * (STEADY[at][i] + (share * (STEADY[at + 1][i] - STEADY[at][i])));
    }
}

static void begin_vehicle(controller *c)
{
    place_vehicle(c, c->reading_start);
    (void)memcpy(c->vehicle_start, c->vehicle, sizeof c->vehicle_start);
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        c->at_cut[j] = row(&CUT_BY_READING, j, c->reading_start) + row(&CUT_BY_COMMAND, j, c->sent_start);
        c->load[j] = (controller_real)0.0;
        c->angle[j] = (controller_real)0.0;
    }
    c->distance = (controller_real)0.0;
#if CONTROLLER_CLUTCHES > 0
    (void)memset(c->carried, 0, sizeof c->carried);
#endif
#if CONTROLLER_PULSES > 0
    for (int32_t n = 0; n < CONTROLLER_PULSES; n++) {
        c->pulse_phase[n] = PULSE_START[n];
        c->pulse_speed[n] = row(&PULSE_TURNS, n, c->vehicle);
        c->pulse_correction[n][0] = (controller_real)0.0;
        c->pulse_correction[n][1] = (controller_real)0.0;
    }
#endif
}

/* lower and upper factors of a matrix, in place, with the rows that were exchanged */
static void factor(controller_real *m, int32_t *pivot)
{
    for (int32_t n = 0; n < VEHICLE; n++) {
        int32_t largest = n;
        for (int32_t i = n + 1; i < VEHICLE; i++) {
            if (fabs((double)m[(i * VEHICLE) + n]) > fabs((double)m[(largest * VEHICLE) + n])) {
                largest = i;
            }
        }
        pivot[n] = largest;
        for (int32_t k = 0; k < VEHICLE; k++) {
            const controller_real moved = m[(n * VEHICLE) + k];
            m[(n * VEHICLE) + k] = m[(largest * VEHICLE) + k];
            m[(largest * VEHICLE) + k] = moved;
        }
        for (int32_t i = n + 1; i < VEHICLE; i++) {
            const controller_real share = m[(i * VEHICLE) + n] / m[(n * VEHICLE) + n];
            m[(i * VEHICLE) + n] = share;
            if (share != (controller_real)0.0) {
                for (int32_t k = n + 1; k < VEHICLE; k++) {
                    m[(i * VEHICLE) + k] -= share * m[(n * VEHICLE) + k];
                }
            }
        }
    }
}

/* the solution for these factors, in place of the right side */
static void solve(const controller_real *m, const int32_t *pivot, controller_real *right)
{
    for (int32_t n = 0; n < VEHICLE; n++) {
        const controller_real moved = right[n];
        right[n] = right[pivot[n]];
        right[pivot[n]] = moved;
    }
    for (int32_t i = 1; i < VEHICLE; i++) {
        for (int32_t k = 0; k < i; k++) {
            right[i] -= m[(i * VEHICLE) + k] * right[k];
        }
    }
    for (int32_t i = VEHICLE - 1; i >= 0; i--) {
        for (int32_t k = i + 1; k < VEHICLE; k++) {
            right[i] -= m[(i * VEHICLE) + k] * right[k];
        }
        right[i] /= m[(i * VEHICLE) + i];
    }
}

/* friction of each tyre, mass, grade */
static void road_of(const controller *c, controller_real *road)
{
    for (int32_t i = 0; i < CONTROLLER_TYRES; i++) {
        road[i] = c->settings.friction[i];
    }
    road[CONTROLLER_TYRES] = c->settings.mass;
    road[CONTROLLER_TYRES + 1] = c->settings.grade;
}

#if CONTROLLER_PULSES > 0
/* of the pulses in the sample that begins: their torques, held, and what is added to the commands */
static void pulses_of(const controller *c, controller_real *middle, controller_real *added)
{
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        added[j] = (controller_real)0.0;
    }
    for (int32_t n = 0; n < CONTROLLER_PULSES; n++) {
        const controller_real turned = (controller_real)(CONTROLLER_SAMPLE_TIME / 2.0) * PULSE_ORDER[n] *
                                       row(&PULSE_TURNS, n, c->vehicle);
        const controller_real sine = PULSE_AMPLITUDE[n] * (controller_real)sin((double)c->pulse_phase[n]);
        const controller_real cosine = PULSE_AMPLITUDE[n] * (controller_real)cos((double)c->pulse_phase[n]);
        controller_real share = (controller_real)0.0;
        const int32_t at = place(PULSE_SPEED[n], CONTROLLER_PULSE_SPEEDS, c->pulse_speed[n], &share);
        middle[n] = PULSE_AMPLITUDE[n] * (controller_real)sin((double)(c->pulse_phase[n] + turned));
        for (int32_t j = 0; j < DYNAMOMETERS; j++) {
            const controller_real *low = PULSE_GAIN[n][at][j];
            const controller_real *high = PULSE_GAIN[n][at + 1][j];
            added[j] += (sine * (low[0] + (share * (high[0] - low[0])))) +
                        (cosine * (low[1] + (share * (high[1] - low[1]))));
        }
        added[PULSE_MACHINE[n]] += (c->pulse_correction[n][0] * (controller_real)sin((double)c->pulse_phase[n])) +
                                   (c->pulse_correction[n][1] * (controller_real)cos((double)c->pulse_phase[n]));
    }
}

/* what the speed at the cut is off, in step with the pulse, corrects what is added; beyond the table it is forgotten */
static void correct_pulse(controller *c, int32_t n, controller_real error)
{
    const controller_real part = (controller_real)CONTROLLER_PULSE_CORRECTING;
    const controller_real speed = c->pulse_speed[n];
    controller_real *now = c->pulse_correction[n];
    if ((speed < PULSE_SPEED[n][0]) || (speed >= PULSE_SPEED[n][CONTROLLER_PULSE_SPEEDS - 1])) {
        now[0] *= (controller_real)1.0 - part;
        now[1] *= (controller_real)1.0 - part;
    } else {
        controller_real share = (controller_real)0.0;
        const int32_t at = place(PULSE_SPEED[n], CONTROLLER_PULSE_SPEEDS, speed, &share);
        const controller_real *low = PULSE_ANSWER[n][at];
        const controller_real *high = PULSE_ANSWER[n][at + 1];
        const controller_real real = low[0] + (share * (high[0] - low[0]));
        const controller_real imaginary = low[1] + (share * (high[1] - low[1]));
        /* twice the error, turned back by the phase: 2j * exp(-j * phase) */
        const controller_real size = (controller_real)2.0 * error * part / ((real * real) + (imaginary * imaginary));
        const controller_real sine = size * (controller_real)sin((double)c->pulse_phase[n]);
        const controller_real cosine = size * (controller_real)cos((double)c->pulse_phase[n]);
        now[0] -= (sine * real) + (cosine * imaginary);
        now[1] -= (cosine * real) - (sine * imaginary);
    }
}

/* phases a sample later, and speeds of the engine, averaged: it turns unevenly with each pulse */
static void turn_pulses(controller *c, const controller_input *in, const controller_real *before, const bool *is_free)
{
    for (int32_t n = 0; n < CONTROLLER_PULSES; n++) {
        const int32_t j = PULSE_MACHINE[n];
        if (is_free[j]) {
            correct_pulse(c, n, (in->reading[SPEED_READING[j]] / OVER[j]) - row(&WHEEL, j, before));
        }
    }
    for (int32_t n = 0; n < CONTROLLER_PULSES; n++) {
        const controller_real now = row(&PULSE_TURNS, n, c->vehicle);
        const controller_real phase = c->pulse_phase[n] + ((controller_real)(CONTROLLER_SAMPLE_TIME / 2.0) *
                                                           PULSE_ORDER[n] * (row(&PULSE_TURNS, n, before) + now));
        c->pulse_phase[n] = (controller_real)((double)phase - (TURN * floor((double)phase / TURN)));
        c->pulse_speed[n] += (controller_real)CONTROLLER_PULSE_SMOOTHING * (now - c->pulse_speed[n]);
    }
}
#endif

#if CONTROLLER_CLUTCHES > 0
/* slip of each clutch */
static void slips_of(const controller *c, controller_real *slip)
{
    for (int32_t i = 0; i < CONTROLLER_CLUTCHES; i++) {
        slip[i] = row(&SLIP, i, c->vehicle);
    }
}

/* what a clutch can carry: noise below 0 would drive */
static controller_real capacity_of(const controller_real *own, int32_t i)
{
    const controller_real most = own[(CONTROLLER_VEHICLE_INPUTS - CONTROLLER_CLUTCHES) + i];
    return (most > (controller_real)0.0) ? most : (controller_real)0.0;
}

/* a clutch slips or is open */
static bool is_slipping(const controller *c, const controller_real *own)
{
    controller_real slip[CONTROLLER_CLUTCHES];
    bool slips = false;
    slips_of(c, slip);
    for (int32_t i = 0; i < CONTROLLER_CLUTCHES; i++) {
        if ((capacity_of(own, i) <= (controller_real)0.0) || (fabs((double)slip[i]) > CONTROLLER_SLIPS)) {
            slips = true;
        }
    }
    return slips;
}

/* what the clutches carry now, in place of what they can carry */
static void let_clutches_carry(const controller *c, controller_real *own)
{
    controller_real slip[CONTROLLER_CLUTCHES];
    slips_of(c, slip);
    for (int32_t i = 0; i < CONTROLLER_CLUTCHES; i++) {
        const controller_real most = capacity_of(own, i);
        controller_real now = within(c->carried[i], -most, most);
        if (fabs((double)slip[i]) > CONTROLLER_SLIPS) {
            now = (slip[i] > (controller_real)0.0) ? most : -most;
        }
        own[(CONTROLLER_VEHICLE_INPUTS - CONTROLLER_CLUTCHES) + i] = now;
    }
}

/* Torques with which the clutches stick at the end of a step, or all that they can carry, from a step with those before
 * it: `w` are factors of its matrix, `slopes` (column by column) what it was made of. */
static void end_slips(controller *c, const controller_real *w, const int32_t *pivot, const controller_real *slopes,
                      const controller_real *own)
{
    const controller_real h = (controller_real)CONTROLLER_SAMPLE_TIME / (controller_real)CONTROLLER_PIECES;
    controller_real by[CONTROLLER_CLUTCHES][VEHICLE]; /* states at the end of the step for 1 N*m */
    controller_real gain[CONTROLLER_CLUTCHES][CONTROLLER_CLUTCHES];
    controller_real slip[CONTROLLER_CLUTCHES];
    controller_real more[CONTROLLER_CLUTCHES] = {(controller_real)0.0};
    for (int32_t i = 0; i < CONTROLLER_CLUTCHES; i++) {
        controller_real first[VEHICLE];
        controller_real second[VEHICLE];
        for (int32_t n = 0; n < VEHICLE; n++) {
            first[n] = BY_CLUTCH[i][n];
        }
        solve(w, pivot, first);
        for (int32_t n = 0; n < VEHICLE; n++) {
            controller_real ahead = (controller_real)0.0;
            for (int32_t k = 0; k < VEHICLE; k++) {
                ahead += slopes[(k * VEHICLE) + n] * first[k];
            }
            second[n] = (BY_CLUTCH[i][n] + (h * ahead)) - ((controller_real)2.0 * first[n]);
        }
        solve(w, pivot, second);
        for (int32_t n = 0; n < VEHICLE; n++) {
            by[i][n] = h * (((controller_real)1.5 * first[n]) + ((controller_real)0.5 * second[n]));
        }
    }
    slips_of(c, slip);
    for (int32_t i = 0; i < CONTROLLER_CLUTCHES; i++) {
        for (int32_t k = 0; k < CONTROLLER_CLUTCHES; k++) {
            gain[i][k] = row(&SLIP, i, by[k]);
        }
    }
    for (int32_t sweep = 0; sweep < CONTROLLER_SWEEPS; sweep++) {
        for (int32_t i = 0; i < CONTROLLER_CLUTCHES; i++) {
            const controller_real most = capacity_of(own, i);
            controller_real off = slip[i];
            for (int32_t k = 0; k < CONTROLLER_CLUTCHES; k++) {
                off += gain[i][k] * more[k];
            }
            more[i] = within((c->carried[i] + more[i]) - (off / gain[i][i]), -most, most) - c->carried[i];
        }
    }
    for (int32_t i = 0; i < CONTROLLER_CLUTCHES; i++) {
        c->carried[i] += more[i];
        for (int32_t n = 0; n < VEHICLE; n++) {
            c->vehicle[n] += by[i][n] * more[i];
        }
    }
}
#endif

static void add_rates(controller_real *rates, const controller_real *more)
{
    for (int32_t i = 0; i < VEHICLE; i++) {
        rates[i] += more[i];
    }
}

/* a sample of the vehicle with these torques at its cuts: ROS2, linearly implicit, stable whatever is fast in it */
static void step_vehicle(controller *c, const controller_real *torque, const controller_real *told,
                         const controller_real *pulsing)
{
#if CONTROLLER_CLUTCHES > 0
    controller_real own[CONTROLLER_VEHICLE_INPUTS];
    controller_real slopes[VEHICLE * VEHICLE];
    (void)memcpy(own, told, sizeof own);
#else
    const controller_real *own = told;
#endif
    const controller_real h = (controller_real)CONTROLLER_SAMPLE_TIME / (controller_real)CONTROLLER_PIECES;
    controller_real road[CONTROLLER_TYRES + 2];
    road_of(c, road);
    for (int32_t piece = 0; piece < CONTROLLER_PIECES; piece++) {
        controller_real m[VEHICLE * VEHICLE];
        controller_real first[VEHICLE];
        controller_real second[VEHICLE];
        controller_real ahead[VEHICLE];
        int32_t pivot[VEHICLE];
#if CONTROLLER_CLUTCHES > 0
        (void)memcpy(own + (CONTROLLER_VEHICLE_INPUTS - CONTROLLER_CLUTCHES), c->carried, sizeof c->carried);
#endif
        slopes_of(c->vehicle, torque, own, road, m); /* column by column */
#if CONTROLLER_CLUTCHES > 0
        (void)memcpy(slopes, m, sizeof slopes);
#endif
        for (int32_t i = 0; i < VEHICLE; i++) {
            for (int32_t k = i; k < VEHICLE; k++) {
                const controller_real above = m[(k * VEHICLE) + i];
                const controller_real below = m[(i * VEHICLE) + k];
                const controller_real one = (i == k) ? (controller_real)1.0 : (controller_real)0.0;
                m[(i * VEHICLE) + k] = one - (GAMMA * h * above);
                m[(k * VEHICLE) + i] = one - (GAMMA * h * below);
            }
        }
        factor(m, pivot);
        rates_of(c->vehicle, torque, own, road, first);
        add_rates(first, pulsing);
        solve(m, pivot, first);
        for (int32_t i = 0; i < VEHICLE; i++) {
            ahead[i] = c->vehicle[i] + (h * first[i]);
        }
        rates_of(ahead, torque, own, road, second);
        add_rates(second, pulsing);
        for (int32_t i = 0; i < VEHICLE; i++) {
            second[i] -= (controller_real)2.0 * first[i];
        }
        solve(m, pivot, second);
        for (int32_t i = 0; i < VEHICLE; i++) {
            c->vehicle[i] += h * (((controller_real)1.5 * first[i]) + ((controller_real)0.5 * second[i]));
        }
#if CONTROLLER_CLUTCHES > 0
        end_slips(c, m, pivot, slopes, told);
#endif
    }
}

static controller_real body_speed(const controller *c)
{
    controller_real speed = (controller_real)0.0;
    for (int32_t i = 0; i < VEHICLE; i++) {
        speed += BODY[i] * c->vehicle[i];
    }
    return speed;
}

static void show_vehicle(const controller *c, controller_output *out)
{
    controller_real own[CONTROLLER_VEHICLE_INPUTS + 1] = {(controller_real)0.0};
    controller_real torque[DYNAMOMETERS] = {(controller_real)0.0};
    controller_real road[CONTROLLER_TYRES + 2];
    controller_real found[(3 * CONTROLLER_TYRES) + 1];
    road_of(c, road);
    outputs_of(c->vehicle, torque, own, road, found);
    out->vehicle_speed = (controller_real)CONTROLLER_RADIUS * body_speed(c);
    out->vehicle_distance = c->distance;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        out->wheel_speed[j] = row(&WHEEL, j, c->vehicle);
    }
    for (int32_t i = 0; i < CONTROLLER_TYRES; i++) {
        out->slip[i] = found[i];
        out->tyre_torque[i] = found[CONTROLLER_TYRES + i];
    }
}

/* the speed at which the vehicle's tyres would damp as they do now: near their largest torque as at a much higher one */
static controller_real schedule_speed(const controller *c, controller_real speed)
{
    controller_real slope = (controller_real)1.0;
    const controller_real own[CONTROLLER_VEHICLE_INPUTS + 1] = {(controller_real)0.0};
    const controller_real torque[DYNAMOMETERS] = {(controller_real)0.0};
    controller_real road[CONTROLLER_TYRES + 2];
    controller_real found[(3 * CONTROLLER_TYRES) + 1];
    road_of(c, road);
    outputs_of(c->vehicle, torque, own, road, found);
    for (int32_t i = 0; i < CONTROLLER_TYRES; i++) {
        if (found[(2 * CONTROLLER_TYRES) + i] < slope) {
            slope = found[(2 * CONTROLLER_TYRES) + i];
        }
    }
    return speed / ((slope > SMALLEST_SLOPE) ? slope : SMALLEST_SLOPE);
}

/* rates that the observer's vehicle lacks: of what the vehicle does beyond it where it is, and of the loads; `slips`: a
 * clutch of it does, else all are locked in the observer */
static void remainder_of(const controller *c, const controller_input *in, int32_t at, controller_real share, bool slips,
                         controller_real *found)
{
    const int32_t first = KNOWN - CONTROLLER_VEHICLE_INPUTS;
    controller_real own[CONTROLLER_VEHICLE_INPUTS + 1];
    controller_real off[VEHICLE];
    controller_real road[CONTROLLER_TYRES + 2];
    road_of(c, road);
    for (int32_t i = 0; i < CONTROLLER_VEHICLE_INPUTS; i++) {
        own[i] = (NONLINEAR[i] > (controller_real)0.0) ? in->known[first + i] : c->known_start[first + i];
    }
    for (int32_t i = 0; i < VEHICLE; i++) {
        off[i] = c->vehicle[i] - c->vehicle_start[i];
    }
#if CONTROLLER_CLUTCHES > 0
    controller_real seen[LOCKED];
    controller_real rates[VEHICLE];
    for (int32_t i = 0; i < LOCKED; i++) {
        seen[i] = row(&SEEN, i, c->vehicle);
    }
    if (slips) {
        let_clutches_carry(c, own);
        rates_of(c->vehicle, c->at_cut, own, road, rates);
    } else {
        locked_of(seen, c->at_cut, own, road, found);
    }
    for (int32_t i = 0; i < LOCKED; i++) {
        seen[i] = row(&SEEN, i, off);
        if (slips) {
            found[i] = row(&SEEN, i, rates);
        }
    }
    for (int32_t i = 0; i < LOCKED; i++) {
        found[i] += row(slips ? &BY_CUT_SLIPPING : &BY_CUT, i, c->load) - between(LIKENESS, at, share, i, seen);
    }
#else
    (void)slips;
    rates_of(c->vehicle, c->at_cut, own, road, found);
    for (int32_t i = 0; i < VEHICLE; i++) {
        found[i] += row(&BY_CUT, i, c->load) - between(LIKENESS, at, share, i, off);
    }
#endif
}

/* wheels of the vehicle less those that the observer expects; the angle between a rotor and a wheel that stands is taken
 * back slowly, and forgotten as the wheel rolls */
static void compare_wheels(controller *c, const controller_input *in, controller_real *off)
{
    const controller_real h = (controller_real)CONTROLLER_SAMPLE_TIME;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const controller_real wheel = row(&WHEEL, j, c->vehicle);
        const controller_real apart = (in->reading[SPEED_READING[j]] / OVER[j]) - wheel;
        const controller_real rolled = (controller_real)fabs((double)wheel) / (controller_real)CONTROLLER_ANGLE_ROLL;
        c->angle[j] = (c->angle[j] + (h * apart)) / ((controller_real)1.0 + (h * rolled));
        off[j] = wheel - (c->angle[j] / (controller_real)CONTROLLER_ANGLE_TIME) - row(&WHEEL, j, c->vehicle_start) -
                 row(&LOCKED_WHEEL, j, c->state + OBSERVED);
    }
}
#endif

static void enter(controller *c, const controller_input *in, int32_t mode)
{
    if (mode != c->mode) {
        c->mode = mode;
        if (mode != CONTROLLER_EMULATION) {
            c->averaged = 0;
        }
        if (mode == CONTROLLER_SPEED_HOLD) {
            for (int32_t j = 0; j < DYNAMOMETERS; j++) {
                /* a rotor whose load is gone would be swung by the torque that balanced it */
                const bool gone = (c->fault == CONTROLLER_TORQUE_GONE) && (c->gone[j] != 0);
                const controller_real carried = gone ? (controller_real)0.0 : c->sent[j];
                const bool blind = c->distrusted[SPEED_READING[j]] != 0;
                const controller_real error =
                    blind ? (controller_real)0.0 : (wanted_speed(c, in, j) - in->reading[SPEED_READING[j]]);
                c->integral[j] = carried - (c->settings.hold_proportional[j] * error);
#if CONTROLLER_FOREIGN > 0
                c->cut_integral[j] = c->cut_torque[j];
#endif
            }
        }
        if (mode == CONTROLLER_EMULATION) {
            (void)memset(c->state, 0, sizeof c->state);
            average(c, in);
            start_of(c->reading_start, c->mean, c->slow, READINGS);
            start_of(c->known_start, c->known_mean, c->known_slow, KNOWN);
            start_of(c->sent_start, c->sent_mean, c->sent_slow, DYNAMOMETERS);
#if CONTROLLER_VEHICLE_STATES > 0
            begin_vehicle(c);
#endif
#if CONTROLLER_FOREIGN > 0
            begin_foreign(c, in);
#endif
            for (int32_t n = 0; n < CONTROLLER_KEPT; n++) {
                for (int32_t j = 0; j < DYNAMOMETERS; j++) {
                    c->past_torque[n][j] = flange_torque(in, j);
                }
            }
            (void)memset(c->deviation, 0, sizeof c->deviation);
            (void)memset(c->off_mean, 0, sizeof c->off_mean);
            (void)memset(c->lost, 0, sizeof c->lost);
            (void)memset(c->seems_open, 0, sizeof c->seems_open);
            (void)memset(c->carried_for, 0, sizeof c->carried_for);
            (void)memset(c->undelivered_for, 0, sizeof c->undelivered_for);
            c->surprised = 0;
        }
    }
}

/* the largest torque at the speed that is read */
static controller_real torque_limit(const controller *c, const controller_input *in, int32_t j)
{
    const controller_settings *own = &c->settings;
    const controller_real slowest = (controller_real)CONTROLLER_SLOWEST;
    const controller_real speed = (controller_real)fabs((double)in->reading[SPEED_READING[j]]);
    const controller_real of_power = own->power_limit[j] / ((speed > slowest) ? speed : slowest);
    controller_real of_curve = own->curve_torque[CONTROLLER_CURVE - 1];
    for (int32_t n = CONTROLLER_CURVE - 1; n > 0; n--) {
        if (speed < own->curve_speed[n]) {
            const controller_real share =
                (speed - own->curve_speed[n - 1]) / (own->curve_speed[n] - own->curve_speed[n - 1]);
            of_curve = own->curve_torque[n - 1] + (share * (own->curve_torque[n] - own->curve_torque[n - 1]));
        }
    }
    if (speed < own->curve_speed[0]) {
        of_curve = own->curve_torque[0];
    }
    return within((of_power < of_curve) ? of_power : of_curve, (controller_real)0.0, own->torque_limit[j]);
}

/* what was learned over repetitions of a manoeuvre, from its trigger on; nothing before and after */
static controller_real learned_torque(const controller *c, int32_t j)
{
    return ((c->played > 0) && (c->played <= CONTROLLER_LEARNED)) ? LEARNED[c->played - 1][j] : (controller_real)0.0;
}

static void follow_trigger(controller *c, const controller_input *in)
{
    if ((in->trigger != 0) && (c->triggered == 0)) {
        c->played = 1;
    } else if ((c->played > 0) && (c->played <= CONTROLLER_LEARNED)) {
        c->played++;
    } else {
        /* nothing is played */
    }
    c->triggered = in->trigger;
}

/* one sample; `held`: the commands before it were held, since it did not run */
static void emulate(controller *c, const controller_input *in, bool held)
{
    controller_real z[WIDTH];
    controller_real deviation[READINGS];
    controller_real share = (controller_real)0.0;
    int32_t at = 0;
#if CONTROLLER_VEHICLE_STATES > 0
    controller_real off[DYNAMOMETERS];
    controller_real torque[DYNAMOMETERS];
    controller_real pulsing[VEHICLE] = {(controller_real)0.0}; /* rates of the vehicle by its pulses */
    controller_real of_pulses[DYNAMOMETERS] = {(controller_real)0.0};
#if CONTROLLER_CLUTCHES > 0
    const bool slips = is_slipping(c, in->known + (KNOWN - CONTROLLER_VEHICLE_INPUTS));
#else
    const bool slips = false;
#endif
#if CONTROLLER_PULSES > 0
    controller_real before[VEHICLE];
    controller_real pulses[CONTROLLER_PULSES];
    bool is_free[DYNAMOMETERS];
    (void)memcpy(before, c->vehicle, sizeof before);
    pulses_of(c, pulses, of_pulses);
    for (int32_t i = 0; i < VEHICLE; i++) {
        pulsing[i] = row(&BY_PULSE, i, pulses);
    }
#endif
    const controller_real speed = body_speed(c);
    at = place(SPEED, CONTROLLER_DESIGNS, schedule_speed(c, speed), &share);
    at += slips ? CONTROLLER_DESIGNS : 0; /* designs for clutches that slip follow the others */
    compare_wheels(c, in, off);
#endif
#if CONTROLLER_FOREIGN > 0
    controller_real torque[DYNAMOMETERS];
    const controller_real speed = c->body_start + row(&BODY_SPEED, 0, c->state + OBSERVED);
    at = place(SPEED, CONTROLLER_DESIGNS, speed, &share);
#endif
    for (int32_t i = 0; i < READINGS; i++) {
        z[AT_READINGS + i] = in->reading[i] - c->reading_start[i];
        deviation[i] = z[AT_READINGS + i] - row(&EXPECTED, i, c->state);
    }
    for (int32_t i = 0; i < STATES; i++) {
        z[AT_STATE + i] = c->state[i] + between(CORRECTION, at, share, i, deviation);
    }
    for (int32_t i = 0; i < KNOWN; i++) {
        z[AT_KNOWN + i] = in->known[i] - c->known_start[i];
    }
#if CONTROLLER_VEHICLE_STATES > 0
    for (int32_t i = 0; i < LOCKED; i++) {
        z[OBSERVED + i] += between(BY_WHEEL, at, share, i, off);
    }
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        c->load[j] += between(BY_WHEEL, at, share, LOCKED + j, off);
        torque[j] = c->at_cut[j] + (row(&CUT_TORQUE, j, z) / (controller_real)2.0) +
                    (row(slips ? &MOMENTUM_SLIPPING : &MOMENTUM, j, deviation) / (controller_real)CONTROLLER_SAMPLE_TIME);
    }
    remainder_of(c, in, at, share, slips, z + AT_KNOWN + KNOWN);
#if CONTROLLER_PULSES > 0
    if (!slips) { /* a pulse does not pass a clutch that slips */
        for (int32_t i = 0; i < LOCKED; i++) {
            z[AT_KNOWN + KNOWN + i] += row(&LOCKED_BY_PULSE, i, pulses);
        }
    }
#endif
#endif
#if CONTROLLER_FOREIGN > 0
    use_wheels(c, in, at, share, z);
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        torque[j] = c->at_cut[j] + (row(&CUT_TORQUE, j, z) / (controller_real)2.0) +
                    (row(&MOMENTUM, j, deviation) / (controller_real)CONTROLLER_SAMPLE_TIME);
    }
    loads_of(c, speed, at, share, z + AT_KNOWN, z + AT_KNOWN + KNOWN);
#endif
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const controller_real limit = torque_limit(c, in, j);
#if CONTROLLER_VEHICLE_STATES > 0
        const controller_real firing = slips ? (controller_real)0.0 : of_pulses[j];
        const controller_real added = in->added_torque[j] + learned_torque(c, j) + firing;
#else
        const controller_real added = in->added_torque[j] + learned_torque(c, j);
#endif
        const controller_real asked = c->sent_start[j] + between(COMMAND, at, share, j, z) + added;
        if (!held) {
            c->sent[j] = within(asked, -limit, limit);
        }
#if CONTROLLER_PULSES > 0
        is_free[j] = (asked >= -limit) && (asked <= limit) && !held && !slips;
#endif
    }
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        z[AT_SENT + j] = c->sent[j] - c->sent_start[j];
    }
    for (int32_t i = 0; i < STATES; i++) {
        c->state[i] = between(NEXT_STATE, at, share, i, z);
    }
#if CONTROLLER_VEHICLE_STATES > 0
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        torque[j] += row(&CUT_TORQUE, j, c->state) / (controller_real)2.0;
    }
    step_vehicle(c, torque, in->known + (KNOWN - CONTROLLER_VEHICLE_INPUTS), pulsing);
#if CONTROLLER_PULSES > 0
    turn_pulses(c, in, before, is_free);
#endif
    c->distance += (controller_real)(CONTROLLER_SAMPLE_TIME * CONTROLLER_RADIUS / 2.0) * (speed + body_speed(c));
#endif
#if CONTROLLER_FOREIGN > 0
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        for (int32_t n = CONTROLLER_VEHICLE_STEPS - 1; n > 0; n--) {
            c->past_cut[n][j] = c->past_cut[n - 1][j];
        }
        c->past_cut[0][j] = torque[j] + (row(&CUT_TORQUE, j, c->state) / (controller_real)2.0);
    }
#endif
}

static void hold(controller *c, const controller_input *in)
{
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const controller_real limit = torque_limit(c, in, j);
        /* of a rotor whose speed is not trusted others hold the speed; their readings would swing it */
        const bool blind = c->distrusted[SPEED_READING[j]] != 0;
        const controller_real error = wanted_speed(c, in, j) - in->reading[SPEED_READING[j]];
        const controller_real proportional = blind ? (controller_real)0.0 : (c->settings.hold_proportional[j] * error);
        const controller_real asked = proportional + c->integral[j] + in->added_torque[j];
        c->sent[j] = within(asked, -limit, limit);
        if (blind) {
            c->integral[j] *= (controller_real)1.0 - (controller_real)(CONTROLLER_SAMPLE_TIME / CONTROLLER_FADE);
        } else if (c->sent[j] == asked) {
            c->integral[j] += c->settings.hold_integral[j] * (controller_real)CONTROLLER_SAMPLE_TIME * error;
        } else {
            /* at its limit nothing winds up */
        }
    }
}

/* small torques as they are asked for, whatever the readings say */
static void check_channels(controller *c, const controller_input *in)
{
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const controller_real limit = within(torque_limit(c, in, j), (controller_real)0.0, c->settings.check_torque[j]);
        c->sent[j] = within(in->added_torque[j], -limit, limit);
    }
}

static void hold_present_speeds(controller *c, const controller_input *in)
{
    c->fallback = CONTROLLER_SPEED_HOLD;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const controller_real below = (controller_real)CONTROLLER_HELD_BELOW_LIMIT * c->settings.speed_limit[j];
        c->held[j] = within(in->reading[SPEED_READING[j]], -below, below);
    }
}

static void answer_fault(controller *c, const controller_input *in, int32_t fault)
{
    if ((fault != CONTROLLER_NO_FAULT) && (c->fault == CONTROLLER_NO_FAULT) && (c->mode != CONTROLLER_ZERO_TORQUE)) {
        c->fault = fault;
        c->fault_sensor = c->sensor;
        c->fallback = CONTROLLER_ZERO_TORQUE;
        c->holdable = (c->mode != CONTROLLER_CHANNEL_CHECK) ? 1 : 0; /* the speeds are not known before it */
        if (is_holdable(fault) && (c->holdable != 0)) {
            hold_present_speeds(c, in);
        }
    } else if ((fault != CONTROLLER_NO_FAULT) && !is_holdable(fault)) {
        c->fallback = CONTROLLER_ZERO_TORQUE;
    } else if ((fault == CONTROLLER_OVERSPEED) && (c->fault != CONTROLLER_NO_FAULT) &&
               (c->fallback == CONTROLLER_ZERO_TORQUE) && (c->holdable != 0)) {
        hold_present_speeds(c, in); /* without torque the rotors run away, and their speeds are known */
    } else if ((fault == CONTROLLER_NO_FAULT) && (in->mode == CONTROLLER_ZERO_TORQUE)) {
        c->fault = CONTROLLER_NO_FAULT;
        (void)memset(c->distrusted, 0, sizeof c->distrusted);
    } else {
        /* nothing changes */
    }
}

/* samples of an emulation that did not run: a sign of life that rises by one a sample tells how many */
static void catch_up(controller *c, const controller_input *input)
{
    const uint32_t risen = (c->has_life != 0) ? (input->life - c->life) : 0u;
    const int32_t before = c->missed_samples;
    const bool few = (risen > 1u) && ((risen - 1u) <= (uint32_t)c->settings.ride_samples);
    if (c->mode != CONTROLLER_EMULATION) {
        c->missed_samples = 0;
    } else if (few && (c->settings.life_samples > 0) && (c->even_life >= CONTROLLER_EVEN_LIFE)) {
        for (uint32_t n = 1u; n < risen; n++) {
            controller_input in = *input; /* the model says what the readings were */
            for (int32_t i = 0; i < READINGS; i++) {
                in.reading[i] = expected_reading(c, i);
            }
            follow_trigger(c, &in);
            emulate(c, &in, true);
            c->missed_samples++;
        }
    } else {
        /* nothing was missed, or the sign of life does not tell how much */
    }
    c->caught_up = (c->missed_samples > before) ? 1 : 0;
    if (risen == 1u) {
        c->even_life += (c->even_life < (2 * CONTROLLER_EVEN_LIFE)) ? 1 : 0;
    } else if ((risen > 1u) && (c->even_life > 0)) {
        c->even_life -= (c->even_life > 1) ? 2 : 1;
    } else {
        /* no sign of a sample */
    }
}

void controller_step(controller *c, const controller_input *input, controller_output *out)
{
    controller_input seen = *input; /* with the readings as they are used */
    const controller_input *in = &seen;
    if (c->fault == CONTROLLER_NO_FAULT) {
        c->sensor = -1;
        c->fault_sensor = -1;
    }
#if CONTROLLER_VEHICLE_STATES > 0
    if (c->mode == CONTROLLER_EMULATION) {
        show_vehicle(c, out); /* as it is when this sample begins */
    }
#endif
#if CONTROLLER_FOREIGN > 0
    const bool told = all_finite(input->known, KNOWN) && all_finite(input->cut_speed, DYNAMOMETERS);
#else
    const bool told = all_finite(input->known, KNOWN);
#endif
    if (told) {
        catch_up(c, input);
    }
    const int32_t fault = check(c, input, &seen);
    const bool unknown = (fault != CONTROLLER_NO_FAULT) && !is_holdable(fault);
    answer_fault(c, in, fault);
    const int32_t wanted = (c->fault != CONTROLLER_NO_FAULT) ? c->fallback : in->mode;
    enter(c, in, unknown ? CONTROLLER_ZERO_TORQUE : wanted);
    follow_trigger(c, in);
    if (c->mode == CONTROLLER_EMULATION) {
        emulate(c, in, false);
    } else if (c->mode == CONTROLLER_SPEED_HOLD) {
        hold(c, in);
    } else if (c->mode == CONTROLLER_CHANNEL_CHECK) {
        check_channels(c, in);
    } else {
        (void)memset(c->sent, 0, sizeof c->sent);
    }
#if CONTROLLER_FOREIGN > 0
    drive_vehicle(c, in, unknown, out);
#endif
    if (!all_finite(c->sent, DYNAMOMETERS)) { /* a law that has left all bounds */
        c->fault = CONTROLLER_NOT_FINITE;
        c->fallback = CONTROLLER_ZERO_TORQUE;
        c->mode = CONTROLLER_ZERO_TORQUE;
        (void)memset(c->sent, 0, sizeof c->sent);
    }
    if (!unknown) {
        if (c->mode != CONTROLLER_EMULATION) {
            average(c, in);
#if CONTROLLER_VEHICLE_STATES > 0
            place_vehicle(c, in->reading);
#endif
        }
        follow_delivery(c, in);
        track_all(c, in);
        (void)memcpy(c->last, in->reading, sizeof c->last);
        for (int32_t j = 0; j < DYNAMOMETERS; j++) {
            for (int32_t n = CONTROLLER_KEPT - 1; n > 0; n--) {
                c->past_torque[n][j] = c->past_torque[n - 1][j];
            }
            c->past_torque[0][j] = flange_torque(in, j);
        }
    }
#if CONTROLLER_VEHICLE_STATES > 0
    if (c->mode != CONTROLLER_EMULATION) {
        show_vehicle(c, out);
    }
#endif
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        out->command[j] = c->sent[j] / c->settings.torque_gain[j];
    }
    out->mode = c->mode;
    out->fault = c->fault;
    out->fault_sensor = c->fault_sensor;
    out->missed_samples = c->missed_samples;
    show_tracked(c, out);
}
