/* SPDX-License-Identifier: MIT
 *
 * A skate in a bowl, for the tests of the C interface: q = (x, y, heading, z), one holonomic and one nonholonomic constraint,
 *
 *     z - k (x^2 + y^2)/2 = 0,    sin(heading) xd - cos(heading) yd = 0,
 *
 * with every function that the interface knows for it. The energy is constant. Matrices are not symmetric, so that a
 * transposition would show. Faults can be switched on.
 */
#ifndef BOWL_H
#define BOWL_H

#include <math.h>
#include <stddef.h>
#include <string.h>
#include <tandem.h>

enum { N = 4, NH = 1, ND = 1, NC = NH + ND };

enum fault { NONE, RETRY, STOP, GIVE_NAN, GIVE_INFINITY, CALL_BACK, FREE, NEGATE, OFF };

struct bowl {
    double k, m, inertia, g;
    /* The fault of the function that `faulty` names, from the time `fault_at` on. */
    enum fault fault;
    const char *faulty;
    double fault_at, last_t;
    tandem_problem *problem;
    /* Which entry of its value is wrong. */
    int entry;
    int calls, status_of_call_back, eager;
};

static struct bowl new_bowl(void)
{
    struct bowl b = {.k = 0.4, .m = 2.0, .inertia = 0.3, .g = 9.81, .fault_at = -1};
    return b;
}

static const double bowl_q[N] = {1.0, 0.0, 0.5, 0.2};
static const double bowl_qd[N] = {0.8775825618903728, 0.479425538604203, 0.7, 0.4 * 0.8775825618903728};

static int bowl_end(struct bowl *b, const char *name, double t, double *value)
{
    double q[N] = {0};
    b->calls++;
    if (!isnan(t)) b->last_t = t;
    if (b->faulty == NULL || strcmp(b->faulty, name) != 0 || !(b->last_t >= b->fault_at)) return 0;
    switch (b->fault) {
    case RETRY: return 1;
    case STOP: return -1;
    case GIVE_NAN: value[b->entry] = NAN; return 0;
    case GIVE_INFINITY: value[b->entry] = INFINITY; return 0;
    case NEGATE: value[b->entry] = -value[b->entry]; return 0;
    case OFF: value[b->entry] += 0.125; return 0;
    case CALL_BACK: b->status_of_call_back = tandem_start(b->problem, 0, q, q); return 0;
    case FREE: tandem_free(b->problem); return 0;
    default: return 0;
    }
}

static int bowl_phi(double t, const double *q, double *value, void *user_data)
{
    struct bowl *b = user_data;
    value[0] = q[3] - b->k * (q[0] * q[0] + q[1] * q[1]) / 2;
    return bowl_end(b, "holonomic", t, value);
}

static int bowl_phi_q(double t, const double *q, double *value, void *user_data)
{
    struct bowl *b = user_data;
    value[0] = -b->k * q[0];
    value[1] = -b->k * q[1];
    value[2] = 0;
    value[3] = 1;
    return bowl_end(b, "holonomic_jacobian", t, value);
}

static int bowl_e(double t, const double *q, double *value, void *user_data)
{
    value[0] = sin(q[2]);
    value[1] = -cos(q[2]);
    value[2] = value[3] = 0;
    return bowl_end(user_data, "nonholonomic_jacobian", t, value);
}

static int bowl_gamma(double t, const double *q, const double *qd, double *value, void *user_data)
{
    struct bowl *b = user_data;
    value[0] = -b->k * (qd[0] * qd[0] + qd[1] * qd[1]);
    value[1] = qd[2] * (cos(q[2]) * qd[0] + sin(q[2]) * qd[1]);
    return bowl_end(b, "constraint_acceleration", t, value);
}

static int bowl_mass(double t, const double *q, double *value, void *user_data)
{
    struct bowl *b = user_data;
    (void)q;
    memset(value, 0, N * N * sizeof *value);
    value[0] = value[5] = value[15] = b->m;
    value[10] = b->inertia;
    return bowl_end(b, "mass_matrix", t, value);
}

static int bowl_force(double t, const double *q, const double *qd, double *value, void *user_data)
{
    struct bowl *b = user_data;
    (void)q, (void)qd;
    value[0] = value[1] = value[2] = 0;
    value[3] = -b->m * b->g;
    return bowl_end(b, "applied_force", t, value);
}

static int bowl_potential(double t, const double *q, double *value, void *user_data)
{
    struct bowl *b = user_data;
    value[0] = b->m * b->g * q[3];
    return bowl_end(b, "potential_energy", t, value);
}

/* Several terms at once; an eager one computes all of them each time, also those that nobody needs. */
static int bowl_evaluate(int need, double t, const double *q, const double *qd, double *phi, double *jacobian, double *nu,
                         double *gamma, double *mass, double *force, void *user_data)
{
    struct bowl *b = user_data, quiet = *b;
    (void)nu;
    if (b->fault < NEGATE) quiet.faulty = NULL; /* its own fault comes at the end */
    if (b->eager) need = TANDEM_PHI | TANDEM_JACOBIAN | TANDEM_GAMMA | TANDEM_MASS | TANDEM_FORCE;
    if (need & TANDEM_PHI) bowl_phi(t, q, phi, &quiet);
    if (need & TANDEM_JACOBIAN) bowl_phi_q(t, q, jacobian, &quiet), bowl_e(t, q, jacobian + N, &quiet);
    if (need & TANDEM_GAMMA) bowl_gamma(t, q, qd, gamma, &quiet);
    if (need & TANDEM_MASS) bowl_mass(t, q, mass, &quiet);
    if (need & TANDEM_FORCE) bowl_force(t, q, qd, force, &quiet);
    return bowl_end(b, "evaluate", t, need & TANDEM_FORCE ? force : need & TANDEM_PHI ? phi : jacobian);
}

/* Derivatives. */
static int bowl_c2(double t, const double *q, const double *x, double *value, void *user_data)
{
    struct bowl *b = user_data;
    memset(value, 0, NC * N * sizeof *value);
    value[0] = -b->k * x[0];
    value[1] = -b->k * x[1];
    value[N + 2] = cos(q[2]) * x[0] + sin(q[2]) * x[1];
    return bowl_end(b, "jacobian_derivative", t, value);
}

static int bowl_reaction(double t, const double *q, const double *x, double *value, void *user_data)
{
    struct bowl *b = user_data;
    memset(value, 0, N * N * sizeof *value);
    value[0] = value[N + 1] = -b->k * x[0];
    value[2] = x[1] * cos(q[2]);
    value[N + 2] = x[1] * sin(q[2]);
    return bowl_end(b, "reaction_derivative", t, value);
}

static int bowl_gamma_q(double t, const double *q, const double *qd, double *value, void *user_data)
{
    memset(value, 0, NC * N * sizeof *value);
    value[N + 2] = qd[2] * (cos(q[2]) * qd[1] - sin(q[2]) * qd[0]);
    return bowl_end(user_data, "gamma_q", t, value);
}

static int bowl_gamma_qd(double t, const double *q, const double *qd, double *value, void *user_data)
{
    struct bowl *b = user_data;
    memset(value, 0, NC * N * sizeof *value);
    value[0] = -2 * b->k * qd[0];
    value[1] = -2 * b->k * qd[1];
    value[N] = qd[2] * cos(q[2]);
    value[N + 1] = qd[2] * sin(q[2]);
    value[N + 2] = cos(q[2]) * qd[0] + sin(q[2]) * qd[1];
    return bowl_end(b, "gamma_qd", t, value);
}

static int bowl_no_force(double t, const double *q, const double *qd, double *value, void *user_data)
{
    (void)q, (void)qd;
    memset(value, 0, N * N * sizeof *value);
    return bowl_end(user_data, "force_q", t, value);
}

static tandem_problem *bowl_problem(struct bowl *b)
{
    tandem_problem *p = b->problem = tandem_new(N, NH, ND, b);
    tandem_set_position_function(p, "holonomic", bowl_phi);
    tandem_set_position_function(p, "holonomic_jacobian", bowl_phi_q);
    tandem_set_position_function(p, "nonholonomic_jacobian", bowl_e);
    tandem_set_motion_function(p, "constraint_acceleration", bowl_gamma);
    tandem_set_position_function(p, "mass_matrix", bowl_mass);
    tandem_set_motion_function(p, "applied_force", bowl_force);
    tandem_set_position_function(p, "potential_energy", bowl_potential);
    tandem_set_real(p, "step", 1e-2);
    return p;
}

static tandem_problem *bowl_problem_at_once(struct bowl *b)
{
    tandem_problem *p = b->problem = tandem_new(N, NH, ND, b);
    tandem_set_evaluate(p, bowl_evaluate, TANDEM_PHI | TANDEM_JACOBIAN | TANDEM_GAMMA | TANDEM_MASS | TANDEM_FORCE);
    tandem_set_real(p, "step", 1e-2);
    return p;
}

static void bowl_derivatives(tandem_problem *p)
{
    tandem_set_direction_function(p, "jacobian_derivative", bowl_c2);
    tandem_set_direction_function(p, "reaction_derivative", bowl_reaction);
    tandem_set_motion_function(p, "gamma_q", bowl_gamma_q);
    tandem_set_motion_function(p, "gamma_qd", bowl_gamma_qd);
    tandem_set_motion_function(p, "force_q", bowl_no_force);
    tandem_set_motion_function(p, "force_qd", bowl_no_force);
    tandem_set_integer(p, "constant_mass", 1);
}

#endif
