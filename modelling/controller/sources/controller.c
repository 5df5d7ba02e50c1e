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

/* what a row of the law is multiplied with, one after the other */
enum {
    AT_STATE = 0,
    AT_READINGS = STATES,
    AT_KNOWN = AT_READINGS + READINGS,
    AT_REMAINDERS = AT_KNOWN + KNOWN, /* of the observer's vehicle, then of the one that runs ahead */
    AT_SENT = AT_REMAINDERS + 2 * CONTROLLER_VEHICLE_STATES,
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

static bool is_holdable(int32_t fault)
{
    return (fault == CONTROLLER_OVERSPEED) || (fault == CONTROLLER_TORQUE_GONE) || (fault == CONTROLLER_UNEXPECTED);
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
static bool has_lost_torque(controller *c, const controller_input *in)
{
    bool lost = false;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const double least = (double)c->settings.lost_torque[j];
        const double now = flange_torque(in, j);
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

static bool is_unexpected(controller *c)
{
    bool surprised = false;
    for (int32_t i = 0; i < READINGS; i++) {
        if (fabs((double)c->deviation[i]) > (double)c->settings.unexpected[i]) {
            surprised = true;
        }
    }
    c->surprised = surprised ? (c->surprised + 1) : 0;
    return c->surprised >= CONTROLLER_IN_A_ROW;
}

static int32_t check(controller *c, const controller_input *in)
{
    int32_t fault = CONTROLLER_NO_FAULT;
    const bool lifeless = is_lifeless(c, in);
    if (!all_finite(in->reading, READINGS) || !all_finite(in->known, KNOWN) || !all_finite(in->hold_speed, DYNAMOMETERS) ||
        !all_finite(in->added_torque, DYNAMOMETERS)) {
        fault = CONTROLLER_NOT_FINITE;
    } else if (lifeless) {
        fault = CONTROLLER_MISSING;
    } else if (is_frozen(c, in)) {
        fault = CONTROLLER_FROZEN;
    } else if (is_too_fast(c, in)) {
        fault = CONTROLLER_OVERSPEED;
    } else if (c->mode != CONTROLLER_EMULATION) {
        c->surprised = 0;
    } else {
        note_deviation(c, in);
        const bool lost = has_lost_torque(c, in);
        const bool opened = has_opened(c);
        if (lost || opened) {
            fault = CONTROLLER_TORQUE_GONE;
        } else if (is_unexpected(c)) {
            fault = CONTROLLER_UNEXPECTED;
        } else {
            fault = CONTROLLER_NO_FAULT;
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

#if CONTROLLER_VEHICLE_STATES > 0
/* where a value stands on a rising grid: number of the lower neighbour and share of the upper one */
static int32_t place(const controller_real *grid, controller_real value, controller_real *share)
{
    int32_t at = 0;
    for (int32_t n = 1; n < (CONTROLLER_SPEEDS - 1); n++) {
        if (value >= grid[n]) {
            at = n;
        }
    }
    *share = within((value - grid[at]) / (grid[at + 1] - grid[at]), (controller_real)0.0, (controller_real)1.0);
    return at;
}

/* the vehicle begins as it runs steadily at the rotors' speed, below the lowest speed of a grid above 0 in proportion */
static void begin_vehicle(controller *c)
{
    controller_real rotor = (controller_real)0.0;
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        rotor += ROTOR_SHARE[j] * c->reading_start[SPEED_READING[j]];
    }
    controller_real share;
    int32_t at = place(ROTOR_SPEED, rotor, &share);
    at = place(SPEED, SPEED[at] + (share * (SPEED[at + 1] - SPEED[at])), &share);
    controller_real part = (controller_real)1.0;
    if (ROTOR_SPEED[0] > (controller_real)0.0) {
        part = within(rotor / ROTOR_SPEED[0], (controller_real)-1.0, (controller_real)1.0);
    }
    for (int32_t i = 0; i < CONTROLLER_VEHICLE_STATES; i++) {
        c->steady[i] = part * (STEADY[at][i] + (share * (STEADY[at + 1][i] - STEADY[at][i])));
    }
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        c->at_cut[j] = row(&CUT_BY_READING, j, c->reading_start) + row(&CUT_BY_COMMAND, j, c->sent_start);
    }
}

/* what a vehicle does beyond the linear model of this speed, from its states and the known torques less those of the begin */
static void remainder_of(controller *c, const controller_real *off, const controller_real *known, int32_t at,
                         controller_real share, controller_real *found)
{
    controller_real absolute[CONTROLLER_VEHICLE_STATES];
    controller_real own[CONTROLLER_VEHICLE_INPUTS + 1];
    for (int32_t i = 0; i < CONTROLLER_VEHICLE_STATES; i++) {
        absolute[i] = c->steady[i] + off[i];
    }
    for (int32_t i = 0; i < CONTROLLER_VEHICLE_INPUTS; i++) {
        own[i] = c->known_start[KNOWN_INPUT[i]] + (NONLINEAR[i] * known[KNOWN_INPUT[i]]);
    }
    vehicle_rates(absolute, c->at_cut, own, found);
    for (int32_t i = 0; i < CONTROLLER_VEHICLE_STATES; i++) {
        found[i] -= between(VEHICLE, at, share, i, off);
    }
}

static controller_real vehicle_speed(const controller *c)
{
    controller_real speed = (controller_real)0.0;
    for (int32_t i = 0; i < CONTROLLER_VEHICLE_STATES; i++) {
        speed += VEHICLE_SPEED[i] * (c->steady[i] + c->state[OBSERVED + i]);
    }
    return speed;
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
                c->integral[j] = carried - (c->settings.hold_proportional[j] *
                                            (wanted_speed(c, in, j) - in->reading[SPEED_READING[j]]));
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
            for (int32_t n = 0; n < CONTROLLER_KEPT; n++) {
                for (int32_t j = 0; j < DYNAMOMETERS; j++) {
                    c->past_torque[n][j] = flange_torque(in, j);
                }
            }
            (void)memset(c->deviation, 0, sizeof c->deviation);
            (void)memset(c->seems_open, 0, sizeof c->seems_open);
            (void)memset(c->carried_for, 0, sizeof c->carried_for);
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

static void emulate(controller *c, const controller_input *in)
{
    controller_real z[WIDTH];
    controller_real deviation[READINGS];
    controller_real share = (controller_real)0.0;
    int32_t at = 0;
#if CONTROLLER_VEHICLE_STATES > 0
    at = place(SPEED, vehicle_speed(c), &share);
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
    remainder_of(c, z + OBSERVED, z + AT_KNOWN, at, share, z + AT_REMAINDERS);
    remainder_of(c, z + AHEAD, z + AT_KNOWN, at, share, z + AT_REMAINDERS + CONTROLLER_VEHICLE_STATES);
#endif
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const controller_real limit = torque_limit(c, in, j);
        const controller_real added = in->added_torque[j] + learned_torque(c, j);
        c->sent[j] = within(c->sent_start[j] + between(COMMAND, at, share, j, z) + added, -limit, limit);
    }
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        z[AT_SENT + j] = c->sent[j] - c->sent_start[j];
    }
    for (int32_t i = 0; i < STATES; i++) {
        c->state[i] = between(NEXT_STATE, at, share, i, z);
    }
}

static void hold(controller *c, const controller_input *in)
{
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        const controller_real limit = torque_limit(c, in, j);
        const controller_real error = wanted_speed(c, in, j) - in->reading[SPEED_READING[j]];
        const controller_real asked = (c->settings.hold_proportional[j] * error) + c->integral[j] + in->added_torque[j];
        c->sent[j] = within(asked, -limit, limit);
        if (c->sent[j] == asked) {
            c->integral[j] += c->settings.hold_integral[j] * (controller_real)CONTROLLER_SAMPLE_TIME * error;
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

static void answer_fault(controller *c, const controller_input *in, int32_t fault)
{
    if ((fault != CONTROLLER_NO_FAULT) && (c->fault == CONTROLLER_NO_FAULT) && (c->mode != CONTROLLER_ZERO_TORQUE)) {
        c->fault = fault;
        c->fallback = CONTROLLER_ZERO_TORQUE;
        if (is_holdable(fault) && (c->mode != CONTROLLER_CHANNEL_CHECK)) { /* the speeds are not known before it */
            c->fallback = CONTROLLER_SPEED_HOLD;
            for (int32_t j = 0; j < DYNAMOMETERS; j++) {
                const controller_real below = (controller_real)CONTROLLER_HELD_BELOW_LIMIT * c->settings.speed_limit[j];
                c->held[j] = within(in->reading[SPEED_READING[j]], -below, below);
            }
        }
    } else if ((fault != CONTROLLER_NO_FAULT) && !is_holdable(fault)) {
        c->fallback = CONTROLLER_ZERO_TORQUE;
    } else if ((fault == CONTROLLER_NO_FAULT) && (in->mode == CONTROLLER_ZERO_TORQUE)) {
        c->fault = CONTROLLER_NO_FAULT;
    } else {
        /* nothing changes */
    }
}

void controller_step(controller *c, const controller_input *in, controller_output *out)
{
    const int32_t fault = check(c, in);
    const bool unknown = (fault != CONTROLLER_NO_FAULT) && !is_holdable(fault);
    answer_fault(c, in, fault);
    const int32_t wanted = (c->fault != CONTROLLER_NO_FAULT) ? c->fallback : in->mode;
    enter(c, in, unknown ? CONTROLLER_ZERO_TORQUE : wanted);
    follow_trigger(c, in);
    if (c->mode == CONTROLLER_EMULATION) {
        emulate(c, in);
    } else if (c->mode == CONTROLLER_SPEED_HOLD) {
        hold(c, in);
    } else if (c->mode == CONTROLLER_CHANNEL_CHECK) {
        check_channels(c, in);
    } else {
        (void)memset(c->sent, 0, sizeof c->sent);
    }
    if (!all_finite(c->sent, DYNAMOMETERS)) { /* a law that has left all bounds */
        c->fault = CONTROLLER_NOT_FINITE;
        c->fallback = CONTROLLER_ZERO_TORQUE;
        c->mode = CONTROLLER_ZERO_TORQUE;
        (void)memset(c->sent, 0, sizeof c->sent);
    }
    if (!unknown) {
        if (c->mode != CONTROLLER_EMULATION) {
            average(c, in);
        }
        (void)memcpy(c->last, in->reading, sizeof c->last);
        for (int32_t j = 0; j < DYNAMOMETERS; j++) {
            for (int32_t n = CONTROLLER_KEPT - 1; n > 0; n--) {
                c->past_torque[n][j] = c->past_torque[n - 1][j];
            }
            c->past_torque[0][j] = flange_torque(in, j);
        }
    }
    for (int32_t j = 0; j < DYNAMOMETERS; j++) {
        out->command[j] = c->sent[j] / c->settings.torque_gain[j];
    }
    out->mode = c->mode;
    out->fault = c->fault;
}
