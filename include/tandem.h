/* SPDX-License-Identifier: MIT
 *
 * tandem: dynamics of multibody systems with holonomic and nonholonomic constraints. The C interface, for C++ too.
 * doc/linking.md explains it; doc/scene.md and doc/theory.md explain the terms of a model.
 *
 *     Phi(t, q) = 0                holonomic constraints, n_holonomic
 *     E(t, q) qd = e(t, q)         nonholonomic constraints, n_nonholonomic
 *     C qdd = -gamma(t, q, qd)     both, differentiated; C = [Phi_q; E], holonomic rows first
 *     M(q) qdd + C' lambda = S(q, qd) + Q_A(t, q, qd)
 *
 * Functions return a status: 0 or one of the negative TANDEM_ constants; tandem_message() says what is wrong and what to do.
 * Events that change the motion are for Fortran only.
 * Two problems share nothing: threads may work on different problems at the same time, but not on the same one.
 */
#ifndef TANDEM_H
#define TANDEM_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The version of this interface: a thousand times the major number, plus the minor one. A library serves a program if the
 * major numbers are equal and its minor number is not smaller; compare with tandem_interface_version(). */
#define TANDEM_INTERFACE_VERSION 1018

/* Status codes. */
enum {
    TANDEM_OK = 0,
    TANDEM_INVALID_OPTION = -1,
    TANDEM_INVALID_MODEL = -2,
    TANDEM_INCONSISTENT_START = -3,
    TANDEM_RANK_DEFICIENT = -4,
    TANDEM_SINGULAR_MASS = -5,
    TANDEM_CALLBACK_FAILED = -6,
    TANDEM_NOT_EVALUABLE = -7,
    TANDEM_NOT_FINITE = -8,
    TANDEM_POSITION_DIVERGED = -9,
    TANDEM_CHART_LEFT = -10,
    TANDEM_CONSTRAINTS_NOT_HELD = -11,
    TANDEM_STEP_UNDERFLOW = -12,
    TANDEM_STEP_LIMIT = -13,
    TANDEM_OUTPUT_FAILED = -14,
    TANDEM_NEWTON_FAILED = -15,
    TANDEM_INCONSISTENT_ROWS = -16,
    TANDEM_EVENT_LIMIT = -17,
    TANDEM_WORK_LIMIT = -18,
    TANDEM_INVALID_CHECKPOINT = -19,
    TANDEM_INTERRUPTED = -20,
    TANDEM_NO_EQUILIBRIUM = -21
};

/* Terms of a model, for tandem_set_evaluate and `need`: Phi, C, nu = [-Phi_t; e], gamma, M, S + Q_A. */
enum {
    TANDEM_PHI = 1,
    TANDEM_JACOBIAN = 2,
    TANDEM_NU = 4,
    TANDEM_GAMMA = 8,
    TANDEM_MASS = 16,
    TANDEM_FORCE = 32
};

/* A model, its options, and a run of it. */
typedef struct tandem_problem tandem_problem;

/* --- the functions of a model ---------------------------------------------------------------------------------------
 *
 * Each sets all of `value` and returns 0; > 0 where it cannot be evaluated at this point (a smaller step may help), < 0 to
 * stop. One that returns 0 and leaves the last entry as it was has failed (TANDEM_CALLBACK_FAILED). A matrix of r rows is
 * value[r][n], by rows. q, qd and x must not be changed. No exception may leave a function, and
 * a function may call nothing of this interface for its own problem but tandem_get_segment. */

/* holonomic (n_holonomic), holonomic_jacobian (n_holonomic x n), holonomic_rate (n_holonomic), nonholonomic_jacobian
 * (n_nonholonomic x n), nonholonomic_rhs (n_nonholonomic), mass_matrix (n x n; t is NaN), potential_energy (1), nu_derivative
 * (rows of C x n). */
typedef int (*tandem_position_function)(double t, const double *q, double *value, void *user_data);

/* constraint_acceleration (gamma, rows of C), inertia_force (S, n; t is NaN), applied_force (Q_A, n), kinetic_energy (1; t is
 * NaN), gamma_q and gamma_qd (rows of C x n), force_q and force_qd (n x n). */
typedef int (*tandem_motion_function)(double t, const double *q, const double *qd, double *value, void *user_data);

/* jacobian_derivative ((C x)_q, rows of C x n), reaction_derivative ((C' x)_q, n x n), mass_derivative ((M x)_q, n x n; t is
 * NaN), each for a constant vector x. */
typedef int (*tandem_direction_function)(double t, const double *q, const double *x, double *value, void *user_data);

/* Several terms at once: set those in `need`, a sum of TANDEM_PHI ...; the others may be set too. qd is defined only if gamma or
 * force is needed. */
typedef int (*tandem_evaluate_function)(int need, double t, const double *q, const double *qd, double *phi, double *jacobian,
                                        double *nu, double *gamma, double *mass, double *force, void *user_data);

/* --- a problem ------------------------------------------------------------------------------------------------------ */

/* The version of the library's interface. */
int tandem_interface_version(void);

/* A problem with n coordinates. NULL only without memory; tandem_start refuses invalid sizes, which tandem_message() reports at
 * once. user_data is passed to every function of the model. */
tandem_problem *tandem_new(int n, int n_holonomic, int n_nonholonomic, void *user_data);

/* A problem whose model is a mechanism of bodies and joints, described by keys: call tandem_set_key for each, then tandem_define,
 * then any function of other problems except those that set functions of the model. user_data is passed to the functions of
 * events. */
tandem_problem *tandem_new_mechanism(void *user_data);

/* Set the value of a key such as body.rod.mass, as in scene files: a number, "a text" in quotes, true, false, or a list of these
 * in brackets. The keys are those of doc/mechanism.md except scene.planar, which is an argument of tandem_define. */
int tandem_set_key(tandem_problem *problem, const char *key, const char *value);

/* Build the mechanism from its keys. planar != 0: bodies move in the plane; may_be_open != 0: joints may be open in the reference
 * configuration, because tandem_assemble will close them. Kinks of functions of time are searched between t_start and t_end. After
 * a failure keys can be corrected. */
int tandem_define(tandem_problem *problem, int planar, int may_be_open, double t_start, double t_end);

/* Numbers of coordinates and constraints; pointers may be NULL. 0 for a mechanism that is not complete. */
int tandem_get_sizes(tandem_problem *problem, int *n, int *n_holonomic, int *n_nonholonomic);

/* Coordinates and velocities of a mechanism in its reference configuration, n of each. */
int tandem_get_drawing(tandem_problem *problem, double *q, double *qd);

/* Name of a coordinate of a mechanism, its unit, or name of a constraint row; what is "coordinate", "unit" or "row", index from 0.
 * Cut to capacity characters including the NUL. */
int tandem_get_name(tandem_problem *problem, const char *what, int index, int capacity, char *text);

/* Free a problem; NULL is allowed. Later uses of the handle are refused, including a second tandem_free: sixteen bytes of each
 * problem remain until the program ends. */
void tandem_free(tandem_problem *problem);

/* Message of the last call for this problem, beginning with the name of its status; at most 2047 characters. The text belongs to
 * the problem and always has the same address; the next call overwrites it: copy it to keep it. NULL has a message, too. */
const char *tandem_message(const tandem_problem *problem);

/* --- the model: give functions by name, NULL takes one back. Each change, of an energy too, ends a run that is under way: it must
 * be started anew. ----------------------------------------------------------------------------------------------------- */

int tandem_set_position_function(tandem_problem *problem, const char *name, tandem_position_function function);
int tandem_set_motion_function(tandem_problem *problem, const char *name, tandem_motion_function function);
int tandem_set_direction_function(tandem_problem *problem, const char *name, tandem_direction_function function);

/* `provides`: sum of the constants of the terms that the function sets. They take precedence over functions by name. NULL removes
 * the function, with any sum. */
int tandem_set_evaluate(tandem_problem *problem, tandem_evaluate_function function, int provides);

/* Name a constraint row (from 0, holonomic rows first) for messages; up to 96 characters. */
int tandem_set_row_name(tandem_problem *problem, int row, const char *name);

/* Compare every function with differences of another one at ten random states near (t, q, qd), which need not satisfy the
 * constraints: Phi_q and Phi_t with Phi, gamma with C and nu, derivatives with the functions they are derived from, M with its
 * transpose. TANDEM_INVALID_MODEL if one is wrong: the message names it, the entry (value[row][column]) and both values. There is
 * no reference for E, e, M and the forces. Takes some 80 n evaluations of the model; a run is not affected. */
int tandem_check(tandem_problem *problem, double t, const double *q, const double *qd);

/* --- options: a value that cannot be is refused at once, and the one before stays; how options go together is checked by
 * tandem_start. They count from the next tandem_start on; a run that is under way does not notice. ------------------------ */

/* step, rtol, atol, first_step, max_step, constraint_tolerance, utol, btol, htol, intol, v_limit, w_limit, condition_limit,
 * secant_limit, start_tolerance, max_seconds: doc/options.md. rtol = 0 means fixed steps. largest_move_q, largest_move_qd: for
 * tandem_assemble. */
int tandem_set_real(tandem_problem *problem, const char *name, double value);

/* max_steps, max_evaluations, max_events, iteration_limit; constant_mass (1: M does not depend on q and is evaluated once), which
 * belongs to the model: setting it ends a current run. */
int tandem_set_integer(tandem_problem *problem, const char *name, int value);

/* stepper (rk4, dopri5, dop853, trapezoid, sdirk54, radau5, radau, auto), chart_kind (automatic, dense, sparse), chart (every_step,
 * adaptive, paper), refresh, basis, projection (stages, step_ends); velocity_metric (mass, weights) for tandem_assemble. */
int tandem_set_text(tandem_problem *problem, const char *name, const char *value);

/* coordinate_scale (n); breakpoints (ascending times of kinks); nu_jumps (as many; nonzero if nu jumps); mass_blocks (sizes of the
 * diagonal blocks of M, outside of which it is zero). They belong to the model: setting one ends a current run. rtol_q, rtol_qd,
 * atol_q, atol_qd (n): tolerances per coordinate, which are options. fixed_q, fixed_qd, weight_q, weight_qd (n): for
 * tandem_assemble. A count of 0 removes a list. tandem_start and tandem_assemble check the sizes. */
int tandem_set_vector(tandem_problem *problem, const char *name, int count, const double *values);

/* --- events: watched from the next tandem_start on; a run that is under way goes on with those that it was started with ------- */

/* Watch an entry (from 0) of "q", "qd" or "lambda" for a value: direction 1 for a rise through it, -1 for a fall, 0 for both.
 * stops = 0: the event is recorded; else the run ends there, too. Events have numbers in their order, from 0. */
int tandem_add_event(tandem_problem *problem, const char *name, const char *quantity, int index, double value, int direction,
                     int stops);

/* Watch the value (1) of a function for zeros. */
int tandem_add_event_function(tandem_problem *problem, const char *name, tandem_motion_function function, int direction, int stops);

/* Remove all events. */
int tandem_clear_events(tandem_problem *problem);

/* --- a run --------------------------------------------------------------------------------------------------------- */

/* Start at (t, q, qd). Small constraint errors of the start are removed. May be called again at any time. */
int tandem_start(tandem_problem *problem, double t, const double *q, const double *qd);

/* Integrate to t_end, or to an event that stops the run. If t_end is the current time, nothing is done; an earlier one is refused.
 * After a failure the state is that of the last accepted step. */
int tandem_integrate(tandem_problem *problem, double t_end);

/* One accepted step that does not pass t_limit. */
int tandem_step(tandem_problem *problem, double t_limit);

/* At most max_steps accepted steps that do not pass t_end, and rows of states; *rows is their number. at_steps = 0: a row for each
 * of the `capacity` times in `times`, which ascend from the current time, as far as the steps have come; by dense output, which
 * does not affect the steps. Else a row for each step, whose time is stored in `times`. Ends when these are full, at t_end, and at
 * an event that stops the run. Row i is q[i][n], qd[i][n], qdd[i][n]; pointers may be NULL. A failure keeps the rows. */
int tandem_advance(tandem_problem *problem, double t_end, int max_steps, int capacity, int at_steps, double *times, double *q,
                   double *qd, double *qdd, int *rows);

/* Number of events recorded so far. */
int tandem_count_events(tandem_problem *problem, int *count);

/* One of the recorded events, index from 0 in the order of time: its number, its direction through zero (0: it touched zero, or
 * was zero at the start), the time, and the state; pointers may be NULL. */
int tandem_get_event(tandem_problem *problem, int index, int *event, int *direction, double *t, double *q, double *qd);

/* Number of the event that has stopped the run at its current state; -1 if none has. */
int tandem_get_stop(tandem_problem *problem, int *event);

/* Record a run, directly after tandem_start, up to t_end, where a step ends: from there on tandem_estimate_error can be called. */
int tandem_watch_error(tandem_problem *problem, double t_end);

/* Make a second, more accurate run from the same start: the statistics global_error, global_error_q, ... give the error of the
 * first one, as may warnings. Your data of the model must be as at the start. The first run is not affected. */
int tandem_estimate_error(tandem_problem *problem);

/* Move q and qd, near a start, to the nearest state at t that satisfies the constraints; they are unchanged if there is none, or
 * none close enough. The lists fixed_q, fixed_qd, weight_q and weight_qd and the options largest_move_q, largest_move_qd and
 * velocity_metric define the nearest state and the largest distance: doc/linking.md. A run is not affected. */
int tandem_assemble(tandem_problem *problem, double t, double *q, double *qd);

/* Eigenvalues of small motions about a state that satisfies the constraints: `count` of them, at most 2 n, for which re and im
 * must have room, sorted by their real parts. a must have room for 4 n^2 numbers and receives the matrix (count x count) by
 * columns, or is NULL. Zeros due to symmetries and families are exactly zero: doc/linearisation.md. A run is not affected. */
int tandem_linearise(tandem_problem *problem, double t, const double *q, const double *qd, int *count, double *re, double *im,
                     double *a);

/* Move q to the nearest equilibrium, stable or not; unchanged if none is found. A run is not affected. */
int tandem_find_equilibrium(tandem_problem *problem, double t, double *q);

/* Move q and qd to the nearest steady motion, along the motions in a text, separated by blanks or commas: one of a mechanism's
 * symmetries, as "world.rotation_z"; a group of them, as "world.rotation"; "any", or NULL, for all; "world.rotation_z=0.03" for a given rate
 * (rad/s, m/s). q and qd are unchanged if none is found: doc/linearisation.md. A run is not affected. */
int tandem_find_steady_motion(tandem_problem *problem, double t, double *q, double *qd, const char *motions);

/* The current state; pointers may be NULL. */
int tandem_get_state(tandem_problem *problem, double *t, double *q, double *qd, double *qdd);

/* The state at a time within the last step, on the constraints; pointers may be NULL. The run is not affected. */
int tandem_get_state_at(tandem_problem *problem, double t, double *q, double *qd, double *qdd);

/* lambda at a time within the last step, one entry per row of C. */
int tandem_get_multipliers(tandem_problem *problem, double t, double *lambda);

/* Energies of the current state; the potential energy is 0 if the model has none; pointers may be NULL. */
int tandem_get_energies(tandem_problem *problem, double *kinetic, double *potential);

/* steps, rejected, failed, right_hand_sides, charts, largest_position_error, local_error_sum, stiff (1 or 0), n_redundant,
 * wall_seconds, ...: doc/options.md lists them, and so does the message of an unknown name. */
int tandem_get_statistic(tandem_problem *problem, const char *name, double *value);

/* Number of warnings of the run so far: dropped redundant rows, large errors, ... Call it when a run has ended. */
int tandem_count_warnings(tandem_problem *problem, int *count);

/* Text of a warning, index from 0, cut to capacity characters including the NUL. */
int tandem_get_warning(tandem_problem *problem, int index, int capacity, char *text);

/* Save the state of a run as an array of words; *count is their number. words == NULL: only count them; the number may grow during
 * a run. Your own data of the model is not included. The array is valid for the same version of the library on the same machine. */
int tandem_save_state(tandem_problem *problem, int capacity, int64_t *words, int *count);

/* Continue from a saved state, bitwise as without interruption: in a problem with the same model and options that was started, at
 * the same start or another. After a refusal the problem must be started again. */
int tandem_restore_state(tandem_problem *problem, int count, const int64_t *words);

/* Number of the current smooth piece: 1 before the first breakpoint. Functions of the model use it and never compare t with a
 * breakpoint. */
int tandem_get_segment(const tandem_problem *problem);

#ifdef __cplusplus
}
#endif

#endif
