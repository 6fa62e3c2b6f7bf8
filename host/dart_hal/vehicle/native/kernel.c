/* Generated from the Python equations of the vehicle (`make native`); do not edit.
 *
 * BITS 32 or 64: the number type. LANES 0: one vehicle for all cars, its
 * coefficients h[k]; 1: one for each car, h[k * ldh + car]. The coefficients are
 * what depends on parameters and dt alone, computed by the caller.
 */
#include <math.h>
#include <stdint.h>

#if BITS == 32
typedef float real;
#define F(function) function##f
#define LEAST -87.0f
#else
typedef double real;
#define F(function) function
#define LEAST -708.0
#endif
#define R(number) ((real)number)
#if EXACT /* the functions that Python calls */
#define EXP(x) F(exp)(x)
#define COS(x) F(cos)(x)
#else
/* what would underflow takes libmvec out of its vectors, at half the speed of a step */
#define EXP(x) F(exp)(F(fmax)(x, LEAST))
#define COS(x) F(sin)((x) + R(1.5707963267948966))
#endif
#if LANES
#define H(k) h[(k) * ldh + i]
#else
#define H(k) h[k]
#endif
#define BLOCK 128 /* cars that stay in the first cache together */
#define PAD 16    /* cars of the widest vector */
#define INSIDE static inline __attribute__((always_inline)) void

typedef struct {
    int64_t n, samples, substeps, reads; /* cars, rows of input, steps per row, rows of output */
    int64_t ldh, lane, row;              /* strides of h, and of inputs by car and by sample */
    const int64_t *at;                   /* (reads) samples passed, ascending */
    const real *h, *u0, *u1, *start;     /* start (states, n) */
    real *out;                           /* (reads, states, n) */
} job;

INSIDE hold_car_dynamic_paper_all_speeds_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict given)[BLOCK], real (*restrict held)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real tau_command = given[0][i];
        const real s_command = given[1][i];
        held[0][i] = tau_command;
        held[1][i] = s_command;
    }
}

INSIDE step_car_dynamic_paper_all_speeds_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict held)[BLOCK], real (*restrict state)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real x = state[0][i];
        const real y = state[1][i];
        const real eta = state[2][i];
        const real vx = state[3][i];
        const real vy = state[4][i];
        const real om = state[5][i];
        const real tau = state[6][i];
        const real s = state[7][i];
        const real tau_command = held[0][i];
        const real s_command = held[1][i];
        const real v97 = H(27) * (tau - tau_command);
        const real v99 = H(29) * (s - s_command);
        const real v100 = H(28) * v97;
        const real v101 = H(30) * v99;
        const real v103 = tau_command + (H(28) * v100);
        const real v105 = s_command + (H(30) * v101);
        const real v106 = tau_command + v97;
        const real v108 = (s_command + v99) + H(13);
        const real v113 = R(0.5) * (F(tanh)(R(30.0) * v108) + R(1.0));
        const real v123 = ((v113 * H(12)) * F(tanh)(H(11) * v108)) + (((R(1.0) - v113) * H(14)) *
            F(tanh)(H(15) * v108));
        const real v124 = tau_command + v100;
        const real v126 = (s_command + v101) + H(13);
        const real v130 = R(0.5) * (F(tanh)(R(30.0) * v126) + R(1.0));
        const real v140 = ((v130 * H(12)) * F(tanh)(H(11) * v126)) + (((R(1.0) - v130) * H(14)) *
            F(tanh)(H(15) * v126));
        const real v141 = v105 + H(13);
        const real v145 = R(0.5) * (F(tanh)(R(30.0) * v141) + R(1.0));
        const real v155 = ((v145 * H(12)) * F(tanh)(H(11) * v141)) + (((R(1.0) - v145) * H(14)) *
            F(tanh)(H(15) * v141));
        const real v156 = v106 + H(9);
        const real v162 = (R(0.5) * v156) * (F(tanh)(R(100.0) * v156) + R(1.0));
        const real v164 = (-v106) + H(9);
        const real v170 = H(10) * ((R(0.5) * v164) * (F(tanh)(R(100.0) * v164) + R(1.0)));
        const real v175 = COS(v123);
        const real v176 = F(sin)(v123);
        const real v177 = v124 + H(9);
        const real v182 = (R(0.5) * v177) * (F(tanh)(R(100.0) * v177) + R(1.0));
        const real v184 = (-v124) + H(9);
        const real v190 = H(10) * ((R(0.5) * v184) * (F(tanh)(R(100.0) * v184) + R(1.0)));
        const real v192 = H(7) * (v182 - v190);
        const real v194 = H(8) * (v182 + v190);
        const real v195 = COS(v140);
        const real v196 = F(sin)(v140);
        const real v197 = v103 + H(9);
        const real v202 = (R(0.5) * v197) * (F(tanh)(R(100.0) * v197) + R(1.0));
        const real v204 = (-v103) + H(9);
        const real v210 = H(10) * ((R(0.5) * v204) * (F(tanh)(R(100.0) * v204) + R(1.0)));
        const real v215 = COS(v155);
        const real v216 = F(sin)(v155);
        const real v221 = vy + (H(0) * om);
        const real v224 = (vx * v175) + (v221 * v176);
        const real v233 = F(fabs)(vx);
        const real v259 = ((H(7) * (v162 - v170)) - ((H(8) * (v162 + v170)) * vx)) + (-((H(3) *
            F(tanh)(H(4) * vx)) + ((H(5) + (H(6) * v233)) * vx)));
        const real v260 = H(2) * v259;
        const real v262 = H(18) * F(atan2)((vx * v176) - (v221 * v175), F(fmax)(F(fabs)(v224) +
            (R(0.1) * EXP((R(-100.0) * v224) * v224)), H(26)));
        const real v270 = H(16) * F(sin)(H(17) * F(atan)(v262 - (H(19) * (v262 -
            F(atan)(v262)))));
        const real v274 = F(fmax)(H(33), F(fmin)(H(21), H(20) * F(atan2)((H(1) * om) - vy,
            F(fmax)(v233 + (R(0.1) * EXP((R(-100.0) * vx) * vx)), H(26)))));
        const real v277 = (v270 * v175) + (v260 * v176);
        const real v286 = COS(eta);
        const real v287 = F(sin)(eta);
        const real v296 = ((((H(25) * v259) + (v260 * v175)) - (v270 * v176)) * H(23)) + (om *
            vy);
        const real v299 = ((v274 + v277) * H(23)) - (om * vx);
        const real v300 = ((H(0) * v277) - (H(1) * v274)) * H(24);
        const real v302 = eta + (H(31) * om);
        const real v304 = vx + (H(31) * v296);
        const real v306 = vy + (H(31) * v299);
        const real v308 = om + (H(31) * v300);
        const real v310 = v306 + (H(0) * v308);
        const real v313 = (v304 * v195) + (v310 * v196);
        const real v320 = F(fabs)(v304);
        const real v345 = (v192 - (v194 * v304)) + (-((H(3) * F(tanh)(H(4) * v304)) + ((H(5) +
            (H(6) * v320)) * v304)));
        const real v346 = H(2) * v345;
        const real v348 = H(18) * F(atan2)((v304 * v196) - (v310 * v195), F(fmax)(F(fabs)(v313) +
            (R(0.1) * EXP((R(-100.0) * v313) * v313)), H(26)));
        const real v356 = H(16) * F(sin)(H(17) * F(atan)(v348 - (H(19) * (v348 -
            F(atan)(v348)))));
        const real v359 = F(fmax)(H(33), F(fmin)(H(21), H(20) * F(atan2)((H(1) * v308) - v306,
            F(fmax)(v320 + (R(0.1) * EXP((R(-100.0) * v304) * v304)), H(26)))));
        const real v362 = (v356 * v195) + (v346 * v196);
        const real v371 = COS(v302);
        const real v372 = F(sin)(v302);
        const real v381 = ((((H(25) * v345) + (v346 * v195)) - (v356 * v196)) * H(23)) + (v308 *
            v306);
        const real v384 = ((v359 + v362) * H(23)) - (v308 * v304);
        const real v385 = ((H(0) * v362) - (H(1) * v359)) * H(24);
        const real v387 = eta + (H(31) * v308);
        const real v389 = vx + (H(31) * v381);
        const real v391 = vy + (H(31) * v384);
        const real v393 = om + (H(31) * v385);
        const real v395 = v391 + (H(0) * v393);
        const real v398 = (v389 * v195) + (v395 * v196);
        const real v405 = F(fabs)(v389);
        const real v430 = (v192 - (v194 * v389)) + (-((H(3) * F(tanh)(H(4) * v389)) + ((H(5) +
            (H(6) * v405)) * v389)));
        const real v431 = H(2) * v430;
        const real v433 = H(18) * F(atan2)((v389 * v196) - (v395 * v195), F(fmax)(F(fabs)(v398) +
            (R(0.1) * EXP((R(-100.0) * v398) * v398)), H(26)));
        const real v441 = H(16) * F(sin)(H(17) * F(atan)(v433 - (H(19) * (v433 -
            F(atan)(v433)))));
        const real v444 = F(fmax)(H(33), F(fmin)(H(21), H(20) * F(atan2)((H(1) * v393) - v391,
            F(fmax)(v405 + (R(0.1) * EXP((R(-100.0) * v389) * v389)), H(26)))));
        const real v447 = (v441 * v195) + (v431 * v196);
        const real v456 = COS(v387);
        const real v457 = F(sin)(v387);
        const real v466 = ((((H(25) * v430) + (v431 * v195)) - (v441 * v196)) * H(23)) + (v393 *
            v391);
        const real v469 = ((v444 + v447) * H(23)) - (v393 * v389);
        const real v470 = ((H(0) * v447) - (H(1) * v444)) * H(24);
        const real v472 = eta + (H(22) * v393);
        const real v474 = vx + (H(22) * v466);
        const real v476 = vy + (H(22) * v469);
        const real v478 = om + (H(22) * v470);
        const real v480 = v476 + (H(0) * v478);
        const real v483 = (v474 * v215) + (v480 * v216);
        const real v490 = F(fabs)(v474);
        const real v515 = ((H(7) * (v202 - v210)) - ((H(8) * (v202 + v210)) * v474)) + (-((H(3) *
            F(tanh)(H(4) * v474)) + ((H(5) + (H(6) * v490)) * v474)));
        const real v516 = H(2) * v515;
        const real v518 = H(18) * F(atan2)((v474 * v216) - (v480 * v215), F(fmax)(F(fabs)(v483) +
            (R(0.1) * EXP((R(-100.0) * v483) * v483)), H(26)));
        const real v526 = H(16) * F(sin)(H(17) * F(atan)(v518 - (H(19) * (v518 -
            F(atan)(v518)))));
        const real v529 = F(fmax)(H(33), F(fmin)(H(21), H(20) * F(atan2)((H(1) * v478) - v476,
            F(fmax)(v490 + (R(0.1) * EXP((R(-100.0) * v474) * v474)), H(26)))));
        const real v532 = (v526 * v215) + (v516 * v216);
        const real v541 = COS(v472);
        const real v542 = F(sin)(v472);
        state[0][i] = x + (H(32) * ((((vx * v286) - (vy * v287)) + (R(2.0) * (((v304 * v371) -
            (v306 * v372)) + ((v389 * v456) - (v391 * v457))))) + ((v474 * v541) - (v476 *
            v542))));
        state[1][i] = y + (H(32) * ((((vx * v287) + (vy * v286)) + (R(2.0) * (((v304 * v372) +
            (v306 * v371)) + ((v389 * v457) + (v391 * v456))))) + ((v474 * v542) + (v476 *
            v541))));
        state[2][i] = eta + (H(32) * ((om + (R(2.0) * (v308 + v393))) + v478));
        state[3][i] = vx + (H(32) * ((v296 + (R(2.0) * (v381 + v466))) + (((((H(25) * v515) +
            (v516 * v215)) - (v526 * v216)) * H(23)) + (v478 * v476))));
        state[4][i] = vy + (H(32) * ((v299 + (R(2.0) * (v384 + v469))) + (((v529 + v532) * H(23))
            - (v478 * v474))));
        state[5][i] = om + (H(32) * ((v300 + (R(2.0) * (v385 + v470))) + (((H(0) * v532) - (H(1) *
            v529)) * H(24))));
        state[6][i] = v103;
        state[7][i] = v105;
    }
}

void run_car_dynamic_paper_all_speeds_rk4(const job *j)
{
    real state[8][BLOCK] __attribute__((aligned(64)));
    real held[2][BLOCK] __attribute__((aligned(64)));
    real given[2][BLOCK] __attribute__((aligned(64)));
    for (int64_t first = 0; first < j->n; first += BLOCK) {
        const int64_t left = j->n - first, m = left < BLOCK ? left : BLOCK;
        const int64_t w = m == 1 ? 1 : (m + PAD - 1) / PAD * PAD; /* whole vectors */
        const real *h = j->h + (LANES ? first : 0);
        int64_t read = 0;
        for (int q = 0; q < 8; q++)
            for (int64_t i = 0; i < w; i++)
                state[q][i] = j->start[q * j->n + first + (i < m ? i : m - 1)];
        for (int64_t t = 0;; t++) {
            for (; read < j->reads && j->at[read] == t; read++)
                for (int q = 0; q < 8; q++)
                    for (int64_t i = 0; i < m; i++)
                        j->out[(read * 8 + q) * j->n + first + i] = state[q][i];
            if (t == j->samples || read == j->reads)
                break;
            for (int64_t i = 0; i < w; i++) {
                const int64_t from = t * j->row + j->lane * (first + (i < m ? i : m - 1));
                given[0][i] = j->u0[from];
                given[1][i] = j->u1[from];
            }
            hold_car_dynamic_paper_all_speeds_rk4(w, j->ldh, h, given, held);
            for (int64_t sub = 0; sub < j->substeps; sub++)
                step_car_dynamic_paper_all_speeds_rk4(w, j->ldh, h, held, state);
        }
    }
}

INSIDE hold_motion_dynamic_paper_all_speeds_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict given)[BLOCK], real (*restrict held)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real tau = given[0][i];
        const real delta = given[1][i];
        const real v77 = tau + H(9);
        const real v83 = (R(0.5) * v77) * (F(tanh)(R(100.0) * v77) + R(1.0));
        const real v85 = (-tau) + H(9);
        const real v91 = H(10) * ((R(0.5) * v85) * (F(tanh)(R(100.0) * v85) + R(1.0)));
        held[0][i] = H(7) * (v83 - v91);
        held[1][i] = H(8) * (v83 + v91);
        held[2][i] = COS(delta);
        held[3][i] = F(sin)(delta);
    }
}

INSIDE step_motion_dynamic_paper_all_speeds_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict held)[BLOCK], real (*restrict state)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real x = state[0][i];
        const real y = state[1][i];
        const real eta = state[2][i];
        const real vx = state[3][i];
        const real vy = state[4][i];
        const real om = state[5][i];
        const real v93 = held[0][i];
        const real v95 = held[1][i];
        const real v96 = held[2][i];
        const real v97 = held[3][i];
        const real v102 = vy + (H(0) * om);
        const real v105 = (vx * v96) + (v102 * v97);
        const real v114 = F(fabs)(vx);
        const real v140 = (v93 - (v95 * vx)) + (-((H(3) * F(tanh)(H(4) * vx)) + ((H(5) + (H(6) *
            v114)) * vx)));
        const real v141 = H(2) * v140;
        const real v143 = H(13) * F(atan2)((vx * v97) - (v102 * v96), F(fmax)(F(fabs)(v105) +
            (R(0.1) * EXP((R(-100.0) * v105) * v105)), H(21)));
        const real v151 = H(11) * F(sin)(H(12) * F(atan)(v143 - (H(14) * (v143 -
            F(atan)(v143)))));
        const real v155 = F(fmax)(H(24), F(fmin)(H(16), H(15) * F(atan2)((H(1) * om) - vy,
            F(fmax)(v114 + (R(0.1) * EXP((R(-100.0) * vx) * vx)), H(21)))));
        const real v158 = (v151 * v96) + (v141 * v97);
        const real v167 = COS(eta);
        const real v168 = F(sin)(eta);
        const real v177 = ((((H(20) * v140) + (v141 * v96)) - (v151 * v97)) * H(18)) + (om * vy);
        const real v180 = ((v155 + v158) * H(18)) - (om * vx);
        const real v181 = ((H(0) * v158) - (H(1) * v155)) * H(19);
        const real v183 = eta + (H(22) * om);
        const real v185 = vx + (H(22) * v177);
        const real v187 = vy + (H(22) * v180);
        const real v189 = om + (H(22) * v181);
        const real v191 = v187 + (H(0) * v189);
        const real v194 = (v185 * v96) + (v191 * v97);
        const real v201 = F(fabs)(v185);
        const real v226 = (v93 - (v95 * v185)) + (-((H(3) * F(tanh)(H(4) * v185)) + ((H(5) + (H(6)
            * v201)) * v185)));
        const real v227 = H(2) * v226;
        const real v229 = H(13) * F(atan2)((v185 * v97) - (v191 * v96), F(fmax)(F(fabs)(v194) +
            (R(0.1) * EXP((R(-100.0) * v194) * v194)), H(21)));
        const real v237 = H(11) * F(sin)(H(12) * F(atan)(v229 - (H(14) * (v229 -
            F(atan)(v229)))));
        const real v240 = F(fmax)(H(24), F(fmin)(H(16), H(15) * F(atan2)((H(1) * v189) - v187,
            F(fmax)(v201 + (R(0.1) * EXP((R(-100.0) * v185) * v185)), H(21)))));
        const real v243 = (v237 * v96) + (v227 * v97);
        const real v252 = COS(v183);
        const real v253 = F(sin)(v183);
        const real v262 = ((((H(20) * v226) + (v227 * v96)) - (v237 * v97)) * H(18)) + (v189 *
            v187);
        const real v265 = ((v240 + v243) * H(18)) - (v189 * v185);
        const real v266 = ((H(0) * v243) - (H(1) * v240)) * H(19);
        const real v268 = eta + (H(22) * v189);
        const real v270 = vx + (H(22) * v262);
        const real v272 = vy + (H(22) * v265);
        const real v274 = om + (H(22) * v266);
        const real v276 = v272 + (H(0) * v274);
        const real v279 = (v270 * v96) + (v276 * v97);
        const real v286 = F(fabs)(v270);
        const real v311 = (v93 - (v95 * v270)) + (-((H(3) * F(tanh)(H(4) * v270)) + ((H(5) + (H(6)
            * v286)) * v270)));
        const real v312 = H(2) * v311;
        const real v314 = H(13) * F(atan2)((v270 * v97) - (v276 * v96), F(fmax)(F(fabs)(v279) +
            (R(0.1) * EXP((R(-100.0) * v279) * v279)), H(21)));
        const real v322 = H(11) * F(sin)(H(12) * F(atan)(v314 - (H(14) * (v314 -
            F(atan)(v314)))));
        const real v325 = F(fmax)(H(24), F(fmin)(H(16), H(15) * F(atan2)((H(1) * v274) - v272,
            F(fmax)(v286 + (R(0.1) * EXP((R(-100.0) * v270) * v270)), H(21)))));
        const real v328 = (v322 * v96) + (v312 * v97);
        const real v337 = COS(v268);
        const real v338 = F(sin)(v268);
        const real v347 = ((((H(20) * v311) + (v312 * v96)) - (v322 * v97)) * H(18)) + (v274 *
            v272);
        const real v350 = ((v325 + v328) * H(18)) - (v274 * v270);
        const real v351 = ((H(0) * v328) - (H(1) * v325)) * H(19);
        const real v353 = eta + (H(17) * v274);
        const real v355 = vx + (H(17) * v347);
        const real v357 = vy + (H(17) * v350);
        const real v359 = om + (H(17) * v351);
        const real v361 = v357 + (H(0) * v359);
        const real v364 = (v355 * v96) + (v361 * v97);
        const real v371 = F(fabs)(v355);
        const real v396 = (v93 - (v95 * v355)) + (-((H(3) * F(tanh)(H(4) * v355)) + ((H(5) + (H(6)
            * v371)) * v355)));
        const real v397 = H(2) * v396;
        const real v399 = H(13) * F(atan2)((v355 * v97) - (v361 * v96), F(fmax)(F(fabs)(v364) +
            (R(0.1) * EXP((R(-100.0) * v364) * v364)), H(21)));
        const real v407 = H(11) * F(sin)(H(12) * F(atan)(v399 - (H(14) * (v399 -
            F(atan)(v399)))));
        const real v410 = F(fmax)(H(24), F(fmin)(H(16), H(15) * F(atan2)((H(1) * v359) - v357,
            F(fmax)(v371 + (R(0.1) * EXP((R(-100.0) * v355) * v355)), H(21)))));
        const real v413 = (v407 * v96) + (v397 * v97);
        const real v422 = COS(v353);
        const real v423 = F(sin)(v353);
        state[0][i] = x + (H(23) * ((((vx * v167) - (vy * v168)) + (R(2.0) * (((v185 * v252) -
            (v187 * v253)) + ((v270 * v337) - (v272 * v338))))) + ((v355 * v422) - (v357 *
            v423))));
        state[1][i] = y + (H(23) * ((((vx * v168) + (vy * v167)) + (R(2.0) * (((v185 * v253) +
            (v187 * v252)) + ((v270 * v338) + (v272 * v337))))) + ((v355 * v423) + (v357 *
            v422))));
        state[2][i] = eta + (H(23) * ((om + (R(2.0) * (v189 + v274))) + v359));
        state[3][i] = vx + (H(23) * ((v177 + (R(2.0) * (v262 + v347))) + (((((H(20) * v396) +
            (v397 * v96)) - (v407 * v97)) * H(18)) + (v359 * v357))));
        state[4][i] = vy + (H(23) * ((v180 + (R(2.0) * (v265 + v350))) + (((v410 + v413) * H(18))
            - (v359 * v355))));
        state[5][i] = om + (H(23) * ((v181 + (R(2.0) * (v266 + v351))) + (((H(0) * v413) - (H(1) *
            v410)) * H(19))));
    }
}

void run_motion_dynamic_paper_all_speeds_rk4(const job *j)
{
    real state[6][BLOCK] __attribute__((aligned(64)));
    real held[4][BLOCK] __attribute__((aligned(64)));
    real given[2][BLOCK] __attribute__((aligned(64)));
    for (int64_t first = 0; first < j->n; first += BLOCK) {
        const int64_t left = j->n - first, m = left < BLOCK ? left : BLOCK;
        const int64_t w = m == 1 ? 1 : (m + PAD - 1) / PAD * PAD; /* whole vectors */
        const real *h = j->h + (LANES ? first : 0);
        int64_t read = 0;
        for (int q = 0; q < 6; q++)
            for (int64_t i = 0; i < w; i++)
                state[q][i] = j->start[q * j->n + first + (i < m ? i : m - 1)];
        for (int64_t t = 0;; t++) {
            for (; read < j->reads && j->at[read] == t; read++)
                for (int q = 0; q < 6; q++)
                    for (int64_t i = 0; i < m; i++)
                        j->out[(read * 6 + q) * j->n + first + i] = state[q][i];
            if (t == j->samples || read == j->reads)
                break;
            for (int64_t i = 0; i < w; i++) {
                const int64_t from = t * j->row + j->lane * (first + (i < m ? i : m - 1));
                given[0][i] = j->u0[from];
                given[1][i] = j->u1[from];
            }
            hold_motion_dynamic_paper_all_speeds_rk4(w, j->ldh, h, given, held);
            for (int64_t sub = 0; sub < j->substeps; sub++)
                step_motion_dynamic_paper_all_speeds_rk4(w, j->ldh, h, held, state);
        }
    }
}

INSIDE hold_car_dynamic_axle_upstream_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict given)[BLOCK], real (*restrict held)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real tau_command = given[0][i];
        const real s_command = given[1][i];
        held[0][i] = tau_command;
        held[1][i] = s_command;
    }
}

INSIDE step_car_dynamic_axle_upstream_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict held)[BLOCK], real (*restrict state)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real x = state[0][i];
        const real y = state[1][i];
        const real eta = state[2][i];
        const real vx = state[3][i];
        const real vy = state[4][i];
        const real om = state[5][i];
        const real tau = state[6][i];
        const real s = state[7][i];
        const real tau_command = held[0][i];
        const real s_command = held[1][i];
        const real v101 = H(27) * (tau - tau_command);
        const real v103 = H(29) * (s - s_command);
        const real v104 = H(28) * v101;
        const real v105 = H(30) * v103;
        const real v107 = tau_command + (H(28) * v104);
        const real v109 = s_command + (H(30) * v105);
        const real v110 = tau_command + v101;
        const real v112 = (s_command + v103) + H(13);
        const real v117 = R(0.5) * (F(tanh)(R(30.0) * v112) + R(1.0));
        const real v127 = ((v117 * H(12)) * F(tanh)(H(11) * v112)) + (((R(1.0) - v117) * H(14)) *
            F(tanh)(H(15) * v112));
        const real v128 = tau_command + v104;
        const real v130 = (s_command + v105) + H(13);
        const real v134 = R(0.5) * (F(tanh)(R(30.0) * v130) + R(1.0));
        const real v144 = ((v134 * H(12)) * F(tanh)(H(11) * v130)) + (((R(1.0) - v134) * H(14)) *
            F(tanh)(H(15) * v130));
        const real v145 = v109 + H(13);
        const real v149 = R(0.5) * (F(tanh)(R(30.0) * v145) + R(1.0));
        const real v159 = ((v149 * H(12)) * F(tanh)(H(11) * v145)) + (((R(1.0) - v149) * H(14)) *
            F(tanh)(H(15) * v145));
        const real v160 = v110 + H(9);
        const real v166 = (R(0.5) * v160) * (F(tanh)(R(100.0) * v160) + R(1.0));
        const real v168 = (-v110) + H(9);
        const real v174 = H(10) * ((R(0.5) * v168) * (F(tanh)(R(100.0) * v168) + R(1.0)));
        const real v179 = COS(v127);
        const real v180 = F(sin)(v127);
        const real v181 = v128 + H(9);
        const real v186 = (R(0.5) * v181) * (F(tanh)(R(100.0) * v181) + R(1.0));
        const real v188 = (-v128) + H(9);
        const real v194 = H(10) * ((R(0.5) * v188) * (F(tanh)(R(100.0) * v188) + R(1.0)));
        const real v196 = H(7) * (v186 - v194);
        const real v198 = H(8) * (v186 + v194);
        const real v199 = COS(v144);
        const real v200 = F(sin)(v144);
        const real v201 = v107 + H(9);
        const real v206 = (R(0.5) * v201) * (F(tanh)(R(100.0) * v201) + R(1.0));
        const real v208 = (-v107) + H(9);
        const real v214 = H(10) * ((R(0.5) * v208) * (F(tanh)(R(100.0) * v208) + R(1.0)));
        const real v219 = COS(v159);
        const real v220 = F(sin)(v159);
        const real v225 = vy + (H(0) * om);
        const real v228 = (vx * v179) + (v225 * v180);
        const real v235 = F(fabs)(vx);
        const real v260 = ((H(7) * (v166 - v174)) - ((H(8) * (v166 + v174)) * vx)) + (-((H(3) *
            F(tanh)(H(4) * vx)) + ((H(5) + (H(6) * v235)) * vx)));
        const real v261 = H(2) * v260;
        const real v267 = H(24) * F(sin)(H(16) * F(atan)(H(17) * F(atan2)((vx * v180) - (v225 *
            v179), F(fmax)(F(fabs)(v228) + EXP((R(-3.0) * v228) * v228), H(26)))));
        const real v272 = H(25) * F(sin)(H(18) * F(atan)(H(19) * F(atan2)((H(1) * om) - vy,
            F(fmax)(v235 + EXP((R(-3.0) * vx) * vx), H(26)))));
        const real v275 = (v267 * v179) + (v261 * v180);
        const real v284 = COS(eta);
        const real v285 = F(sin)(eta);
        const real v294 = ((((H(23) * v260) + (v261 * v179)) - (v267 * v180)) * H(21)) + (om *
            vy);
        const real v297 = ((v272 + v275) * H(21)) - (om * vx);
        const real v298 = ((H(0) * v275) - (H(1) * v272)) * H(22);
        const real v300 = eta + (H(31) * om);
        const real v302 = vx + (H(31) * v294);
        const real v304 = vy + (H(31) * v297);
        const real v306 = om + (H(31) * v298);
        const real v308 = v304 + (H(0) * v306);
        const real v311 = (v302 * v199) + (v308 * v200);
        const real v317 = F(fabs)(v302);
        const real v341 = (v196 - (v198 * v302)) + (-((H(3) * F(tanh)(H(4) * v302)) + ((H(5) +
            (H(6) * v317)) * v302)));
        const real v342 = H(2) * v341;
        const real v348 = H(24) * F(sin)(H(16) * F(atan)(H(17) * F(atan2)((v302 * v200) - (v308 *
            v199), F(fmax)(F(fabs)(v311) + EXP((R(-3.0) * v311) * v311), H(26)))));
        const real v353 = H(25) * F(sin)(H(18) * F(atan)(H(19) * F(atan2)((H(1) * v306) - v304,
            F(fmax)(v317 + EXP((R(-3.0) * v302) * v302), H(26)))));
        const real v356 = (v348 * v199) + (v342 * v200);
        const real v365 = COS(v300);
        const real v366 = F(sin)(v300);
        const real v375 = ((((H(23) * v341) + (v342 * v199)) - (v348 * v200)) * H(21)) + (v306 *
            v304);
        const real v378 = ((v353 + v356) * H(21)) - (v306 * v302);
        const real v379 = ((H(0) * v356) - (H(1) * v353)) * H(22);
        const real v381 = eta + (H(31) * v306);
        const real v383 = vx + (H(31) * v375);
        const real v385 = vy + (H(31) * v378);
        const real v387 = om + (H(31) * v379);
        const real v389 = v385 + (H(0) * v387);
        const real v392 = (v383 * v199) + (v389 * v200);
        const real v398 = F(fabs)(v383);
        const real v422 = (v196 - (v198 * v383)) + (-((H(3) * F(tanh)(H(4) * v383)) + ((H(5) +
            (H(6) * v398)) * v383)));
        const real v423 = H(2) * v422;
        const real v429 = H(24) * F(sin)(H(16) * F(atan)(H(17) * F(atan2)((v383 * v200) - (v389 *
            v199), F(fmax)(F(fabs)(v392) + EXP((R(-3.0) * v392) * v392), H(26)))));
        const real v434 = H(25) * F(sin)(H(18) * F(atan)(H(19) * F(atan2)((H(1) * v387) - v385,
            F(fmax)(v398 + EXP((R(-3.0) * v383) * v383), H(26)))));
        const real v437 = (v429 * v199) + (v423 * v200);
        const real v446 = COS(v381);
        const real v447 = F(sin)(v381);
        const real v456 = ((((H(23) * v422) + (v423 * v199)) - (v429 * v200)) * H(21)) + (v387 *
            v385);
        const real v459 = ((v434 + v437) * H(21)) - (v387 * v383);
        const real v460 = ((H(0) * v437) - (H(1) * v434)) * H(22);
        const real v462 = eta + (H(20) * v387);
        const real v464 = vx + (H(20) * v456);
        const real v466 = vy + (H(20) * v459);
        const real v468 = om + (H(20) * v460);
        const real v470 = v466 + (H(0) * v468);
        const real v473 = (v464 * v219) + (v470 * v220);
        const real v479 = F(fabs)(v464);
        const real v503 = ((H(7) * (v206 - v214)) - ((H(8) * (v206 + v214)) * v464)) + (-((H(3) *
            F(tanh)(H(4) * v464)) + ((H(5) + (H(6) * v479)) * v464)));
        const real v504 = H(2) * v503;
        const real v510 = H(24) * F(sin)(H(16) * F(atan)(H(17) * F(atan2)((v464 * v220) - (v470 *
            v219), F(fmax)(F(fabs)(v473) + EXP((R(-3.0) * v473) * v473), H(26)))));
        const real v515 = H(25) * F(sin)(H(18) * F(atan)(H(19) * F(atan2)((H(1) * v468) - v466,
            F(fmax)(v479 + EXP((R(-3.0) * v464) * v464), H(26)))));
        const real v518 = (v510 * v219) + (v504 * v220);
        const real v527 = COS(v462);
        const real v528 = F(sin)(v462);
        state[0][i] = x + (H(32) * ((((vx * v284) - (vy * v285)) + (R(2.0) * (((v302 * v365) -
            (v304 * v366)) + ((v383 * v446) - (v385 * v447))))) + ((v464 * v527) - (v466 *
            v528))));
        state[1][i] = y + (H(32) * ((((vx * v285) + (vy * v284)) + (R(2.0) * (((v302 * v366) +
            (v304 * v365)) + ((v383 * v447) + (v385 * v446))))) + ((v464 * v528) + (v466 *
            v527))));
        state[2][i] = eta + (H(32) * ((om + (R(2.0) * (v306 + v387))) + v468));
        state[3][i] = vx + (H(32) * ((v294 + (R(2.0) * (v375 + v456))) + (((((H(23) * v503) +
            (v504 * v219)) - (v510 * v220)) * H(21)) + (v468 * v466))));
        state[4][i] = vy + (H(32) * ((v297 + (R(2.0) * (v378 + v459))) + (((v515 + v518) * H(21))
            - (v468 * v464))));
        state[5][i] = om + (H(32) * ((v298 + (R(2.0) * (v379 + v460))) + (((H(0) * v518) - (H(1) *
            v515)) * H(22))));
        state[6][i] = v107;
        state[7][i] = v109;
    }
}

void run_car_dynamic_axle_upstream_rk4(const job *j)
{
    real state[8][BLOCK] __attribute__((aligned(64)));
    real held[2][BLOCK] __attribute__((aligned(64)));
    real given[2][BLOCK] __attribute__((aligned(64)));
    for (int64_t first = 0; first < j->n; first += BLOCK) {
        const int64_t left = j->n - first, m = left < BLOCK ? left : BLOCK;
        const int64_t w = m == 1 ? 1 : (m + PAD - 1) / PAD * PAD; /* whole vectors */
        const real *h = j->h + (LANES ? first : 0);
        int64_t read = 0;
        for (int q = 0; q < 8; q++)
            for (int64_t i = 0; i < w; i++)
                state[q][i] = j->start[q * j->n + first + (i < m ? i : m - 1)];
        for (int64_t t = 0;; t++) {
            for (; read < j->reads && j->at[read] == t; read++)
                for (int q = 0; q < 8; q++)
                    for (int64_t i = 0; i < m; i++)
                        j->out[(read * 8 + q) * j->n + first + i] = state[q][i];
            if (t == j->samples || read == j->reads)
                break;
            for (int64_t i = 0; i < w; i++) {
                const int64_t from = t * j->row + j->lane * (first + (i < m ? i : m - 1));
                given[0][i] = j->u0[from];
                given[1][i] = j->u1[from];
            }
            hold_car_dynamic_axle_upstream_rk4(w, j->ldh, h, given, held);
            for (int64_t sub = 0; sub < j->substeps; sub++)
                step_car_dynamic_axle_upstream_rk4(w, j->ldh, h, held, state);
        }
    }
}

INSIDE hold_motion_dynamic_axle_upstream_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict given)[BLOCK], real (*restrict held)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real tau = given[0][i];
        const real delta = given[1][i];
        const real v81 = tau + H(9);
        const real v87 = (R(0.5) * v81) * (F(tanh)(R(100.0) * v81) + R(1.0));
        const real v89 = (-tau) + H(9);
        const real v95 = H(10) * ((R(0.5) * v89) * (F(tanh)(R(100.0) * v89) + R(1.0)));
        held[0][i] = H(7) * (v87 - v95);
        held[1][i] = H(8) * (v87 + v95);
        held[2][i] = COS(delta);
        held[3][i] = F(sin)(delta);
    }
}

INSIDE step_motion_dynamic_axle_upstream_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict held)[BLOCK], real (*restrict state)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real x = state[0][i];
        const real y = state[1][i];
        const real eta = state[2][i];
        const real vx = state[3][i];
        const real vy = state[4][i];
        const real om = state[5][i];
        const real v97 = held[0][i];
        const real v99 = held[1][i];
        const real v100 = held[2][i];
        const real v101 = held[3][i];
        const real v106 = vy + (H(0) * om);
        const real v109 = (vx * v100) + (v106 * v101);
        const real v116 = F(fabs)(vx);
        const real v141 = (v97 - (v99 * vx)) + (-((H(3) * F(tanh)(H(4) * vx)) + ((H(5) + (H(6) *
            v116)) * vx)));
        const real v142 = H(2) * v141;
        const real v148 = H(19) * F(sin)(H(11) * F(atan)(H(12) * F(atan2)((vx * v101) - (v106 *
            v100), F(fmax)(F(fabs)(v109) + EXP((R(-3.0) * v109) * v109), H(21)))));
        const real v153 = H(20) * F(sin)(H(13) * F(atan)(H(14) * F(atan2)((H(1) * om) - vy,
            F(fmax)(v116 + EXP((R(-3.0) * vx) * vx), H(21)))));
        const real v156 = (v148 * v100) + (v142 * v101);
        const real v165 = COS(eta);
        const real v166 = F(sin)(eta);
        const real v175 = ((((H(18) * v141) + (v142 * v100)) - (v148 * v101)) * H(16)) + (om *
            vy);
        const real v178 = ((v153 + v156) * H(16)) - (om * vx);
        const real v179 = ((H(0) * v156) - (H(1) * v153)) * H(17);
        const real v181 = eta + (H(22) * om);
        const real v183 = vx + (H(22) * v175);
        const real v185 = vy + (H(22) * v178);
        const real v187 = om + (H(22) * v179);
        const real v189 = v185 + (H(0) * v187);
        const real v192 = (v183 * v100) + (v189 * v101);
        const real v198 = F(fabs)(v183);
        const real v222 = (v97 - (v99 * v183)) + (-((H(3) * F(tanh)(H(4) * v183)) + ((H(5) + (H(6)
            * v198)) * v183)));
        const real v223 = H(2) * v222;
        const real v229 = H(19) * F(sin)(H(11) * F(atan)(H(12) * F(atan2)((v183 * v101) - (v189 *
            v100), F(fmax)(F(fabs)(v192) + EXP((R(-3.0) * v192) * v192), H(21)))));
        const real v234 = H(20) * F(sin)(H(13) * F(atan)(H(14) * F(atan2)((H(1) * v187) - v185,
            F(fmax)(v198 + EXP((R(-3.0) * v183) * v183), H(21)))));
        const real v237 = (v229 * v100) + (v223 * v101);
        const real v246 = COS(v181);
        const real v247 = F(sin)(v181);
        const real v256 = ((((H(18) * v222) + (v223 * v100)) - (v229 * v101)) * H(16)) + (v187 *
            v185);
        const real v259 = ((v234 + v237) * H(16)) - (v187 * v183);
        const real v260 = ((H(0) * v237) - (H(1) * v234)) * H(17);
        const real v262 = eta + (H(22) * v187);
        const real v264 = vx + (H(22) * v256);
        const real v266 = vy + (H(22) * v259);
        const real v268 = om + (H(22) * v260);
        const real v270 = v266 + (H(0) * v268);
        const real v273 = (v264 * v100) + (v270 * v101);
        const real v279 = F(fabs)(v264);
        const real v303 = (v97 - (v99 * v264)) + (-((H(3) * F(tanh)(H(4) * v264)) + ((H(5) + (H(6)
            * v279)) * v264)));
        const real v304 = H(2) * v303;
        const real v310 = H(19) * F(sin)(H(11) * F(atan)(H(12) * F(atan2)((v264 * v101) - (v270 *
            v100), F(fmax)(F(fabs)(v273) + EXP((R(-3.0) * v273) * v273), H(21)))));
        const real v315 = H(20) * F(sin)(H(13) * F(atan)(H(14) * F(atan2)((H(1) * v268) - v266,
            F(fmax)(v279 + EXP((R(-3.0) * v264) * v264), H(21)))));
        const real v318 = (v310 * v100) + (v304 * v101);
        const real v327 = COS(v262);
        const real v328 = F(sin)(v262);
        const real v337 = ((((H(18) * v303) + (v304 * v100)) - (v310 * v101)) * H(16)) + (v268 *
            v266);
        const real v340 = ((v315 + v318) * H(16)) - (v268 * v264);
        const real v341 = ((H(0) * v318) - (H(1) * v315)) * H(17);
        const real v343 = eta + (H(15) * v268);
        const real v345 = vx + (H(15) * v337);
        const real v347 = vy + (H(15) * v340);
        const real v349 = om + (H(15) * v341);
        const real v351 = v347 + (H(0) * v349);
        const real v354 = (v345 * v100) + (v351 * v101);
        const real v360 = F(fabs)(v345);
        const real v384 = (v97 - (v99 * v345)) + (-((H(3) * F(tanh)(H(4) * v345)) + ((H(5) + (H(6)
            * v360)) * v345)));
        const real v385 = H(2) * v384;
        const real v391 = H(19) * F(sin)(H(11) * F(atan)(H(12) * F(atan2)((v345 * v101) - (v351 *
            v100), F(fmax)(F(fabs)(v354) + EXP((R(-3.0) * v354) * v354), H(21)))));
        const real v396 = H(20) * F(sin)(H(13) * F(atan)(H(14) * F(atan2)((H(1) * v349) - v347,
            F(fmax)(v360 + EXP((R(-3.0) * v345) * v345), H(21)))));
        const real v399 = (v391 * v100) + (v385 * v101);
        const real v408 = COS(v343);
        const real v409 = F(sin)(v343);
        state[0][i] = x + (H(23) * ((((vx * v165) - (vy * v166)) + (R(2.0) * (((v183 * v246) -
            (v185 * v247)) + ((v264 * v327) - (v266 * v328))))) + ((v345 * v408) - (v347 *
            v409))));
        state[1][i] = y + (H(23) * ((((vx * v166) + (vy * v165)) + (R(2.0) * (((v183 * v247) +
            (v185 * v246)) + ((v264 * v328) + (v266 * v327))))) + ((v345 * v409) + (v347 *
            v408))));
        state[2][i] = eta + (H(23) * ((om + (R(2.0) * (v187 + v268))) + v349));
        state[3][i] = vx + (H(23) * ((v175 + (R(2.0) * (v256 + v337))) + (((((H(18) * v384) +
            (v385 * v100)) - (v391 * v101)) * H(16)) + (v349 * v347))));
        state[4][i] = vy + (H(23) * ((v178 + (R(2.0) * (v259 + v340))) + (((v396 + v399) * H(16))
            - (v349 * v345))));
        state[5][i] = om + (H(23) * ((v179 + (R(2.0) * (v260 + v341))) + (((H(0) * v399) - (H(1) *
            v396)) * H(17))));
    }
}

void run_motion_dynamic_axle_upstream_rk4(const job *j)
{
    real state[6][BLOCK] __attribute__((aligned(64)));
    real held[4][BLOCK] __attribute__((aligned(64)));
    real given[2][BLOCK] __attribute__((aligned(64)));
    for (int64_t first = 0; first < j->n; first += BLOCK) {
        const int64_t left = j->n - first, m = left < BLOCK ? left : BLOCK;
        const int64_t w = m == 1 ? 1 : (m + PAD - 1) / PAD * PAD; /* whole vectors */
        const real *h = j->h + (LANES ? first : 0);
        int64_t read = 0;
        for (int q = 0; q < 6; q++)
            for (int64_t i = 0; i < w; i++)
                state[q][i] = j->start[q * j->n + first + (i < m ? i : m - 1)];
        for (int64_t t = 0;; t++) {
            for (; read < j->reads && j->at[read] == t; read++)
                for (int q = 0; q < 6; q++)
                    for (int64_t i = 0; i < m; i++)
                        j->out[(read * 6 + q) * j->n + first + i] = state[q][i];
            if (t == j->samples || read == j->reads)
                break;
            for (int64_t i = 0; i < w; i++) {
                const int64_t from = t * j->row + j->lane * (first + (i < m ? i : m - 1));
                given[0][i] = j->u0[from];
                given[1][i] = j->u1[from];
            }
            hold_motion_dynamic_axle_upstream_rk4(w, j->ldh, h, given, held);
            for (int64_t sub = 0; sub < j->substeps; sub++)
                step_motion_dynamic_axle_upstream_rk4(w, j->ldh, h, held, state);
        }
    }
}

INSIDE hold_car_kinematic_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict given)[BLOCK], real (*restrict held)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real tau_command = given[0][i];
        const real s_command = given[1][i];
        held[0][i] = tau_command;
        held[1][i] = s_command;
    }
}

INSIDE step_car_kinematic_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict held)[BLOCK], real (*restrict state)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real x = state[0][i];
        const real y = state[1][i];
        const real eta = state[2][i];
        const real vx = state[3][i];
        const real tau = state[6][i];
        const real s = state[7][i];
        const real tau_command = held[0][i];
        const real s_command = held[1][i];
        const real v61 = H(18) * (tau - tau_command);
        const real v63 = H(20) * (s - s_command);
        const real v64 = H(19) * v61;
        const real v65 = H(21) * v63;
        const real v67 = tau_command + (H(19) * v64);
        const real v69 = s_command + (H(21) * v65);
        const real v70 = tau_command + v61;
        const real v72 = (s_command + v63) + H(12);
        const real v78 = R(0.5) * (F(tanh)(R(30.0) * v72) + R(1.0));
        const real v89 = tau_command + v64;
        const real v91 = (s_command + v65) + H(12);
        const real v95 = R(0.5) * (F(tanh)(R(30.0) * v91) + R(1.0));
        const real v106 = v69 + H(12);
        const real v110 = R(0.5) * (F(tanh)(R(30.0) * v106) + R(1.0));
        const real v121 = v67 + H(8);
        const real v127 = (R(0.5) * v121) * (F(tanh)(R(100.0) * v121) + R(1.0));
        const real v129 = (-v67) + H(8);
        const real v135 = H(9) * ((R(0.5) * v129) * (F(tanh)(R(100.0) * v129) + R(1.0)));
        const real v140 = F(tan)(((v110 * H(11)) * F(tanh)(H(10) * v106)) + (((R(1.0) - v110) *
            H(13)) * F(tanh)(H(14) * v106)));
        const real v141 = v70 + H(8);
        const real v146 = (R(0.5) * v141) * (F(tanh)(R(100.0) * v141) + R(1.0));
        const real v148 = (-v70) + H(8);
        const real v154 = H(9) * ((R(0.5) * v148) * (F(tanh)(R(100.0) * v148) + R(1.0)));
        const real v160 = v89 + H(8);
        const real v165 = (R(0.5) * v160) * (F(tanh)(R(100.0) * v160) + R(1.0));
        const real v167 = (-v89) + H(8);
        const real v173 = H(9) * ((R(0.5) * v167) * (F(tanh)(R(100.0) * v167) + R(1.0)));
        const real v175 = H(6) * (v165 - v173);
        const real v177 = H(7) * (v165 + v173);
        const real v178 = F(tan)(((v95 * H(11)) * F(tanh)(H(10) * v91)) + (((R(1.0) - v95) *
            H(13)) * F(tanh)(H(14) * v91)));
        const real v183 = (vx * F(tan)(((v78 * H(11)) * F(tanh)(H(10) * v72)) + (((R(1.0) - v78) *
            H(13)) * F(tanh)(H(14) * v72)))) * H(16);
        const real v184 = H(1) * v183;
        const real v185 = COS(eta);
        const real v186 = F(sin)(eta);
        const real v206 = (((H(6) * (v146 - v154)) - ((H(7) * (v146 + v154)) * vx)) + (-((H(2) *
            F(tanh)(H(3) * vx)) + ((H(4) + (H(5) * F(fabs)(vx))) * vx)))) * H(17);
        const real v208 = eta + (H(22) * v183);
        const real v210 = vx + (H(22) * v206);
        const real v212 = (v210 * v178) * H(16);
        const real v213 = H(1) * v212;
        const real v214 = COS(v208);
        const real v215 = F(sin)(v208);
        const real v234 = ((v175 - (v177 * v210)) + (-((H(2) * F(tanh)(H(3) * v210)) + ((H(4) +
            (H(5) * F(fabs)(v210))) * v210)))) * H(17);
        const real v236 = eta + (H(22) * v212);
        const real v238 = vx + (H(22) * v234);
        const real v240 = (v238 * v178) * H(16);
        const real v241 = H(1) * v240;
        const real v242 = COS(v236);
        const real v243 = F(sin)(v236);
        const real v262 = ((v175 - (v177 * v238)) + (-((H(2) * F(tanh)(H(3) * v238)) + ((H(4) +
            (H(5) * F(fabs)(v238))) * v238)))) * H(17);
        const real v264 = eta + (H(15) * v240);
        const real v266 = vx + (H(15) * v262);
        const real v268 = (v266 * v140) * H(16);
        const real v269 = H(1) * v268;
        const real v270 = COS(v264);
        const real v271 = F(sin)(v264);
        const real v315 = vx + (H(23) * ((v206 + (R(2.0) * (v234 + v262))) + ((((H(6) * (v127 -
            v135)) - ((H(7) * (v127 + v135)) * v266)) + (-((H(2) * F(tanh)(H(3) * v266)) + ((H(4)
            + (H(5) * F(fabs)(v266))) * v266)))) * H(17))));
        const real v317 = (v315 * v140) / H(0);
        state[0][i] = x + (H(23) * ((((vx * v185) - (v184 * v186)) + (R(2.0) * (((v210 * v214) -
            (v213 * v215)) + ((v238 * v242) - (v241 * v243))))) + ((v266 * v270) - (v269 *
            v271))));
        state[1][i] = y + (H(23) * ((((vx * v186) + (v184 * v185)) + (R(2.0) * (((v210 * v215) +
            (v213 * v214)) + ((v238 * v243) + (v241 * v242))))) + ((v266 * v271) + (v269 *
            v270))));
        state[2][i] = eta + (H(23) * ((v183 + (R(2.0) * (v212 + v240))) + v268));
        state[3][i] = v315;
        state[4][i] = H(1) * v317;
        state[5][i] = v317;
        state[6][i] = v67;
        state[7][i] = v69;
    }
}

void run_car_kinematic_rk4(const job *j)
{
    real state[8][BLOCK] __attribute__((aligned(64)));
    real held[2][BLOCK] __attribute__((aligned(64)));
    real given[2][BLOCK] __attribute__((aligned(64)));
    for (int64_t first = 0; first < j->n; first += BLOCK) {
        const int64_t left = j->n - first, m = left < BLOCK ? left : BLOCK;
        const int64_t w = m == 1 ? 1 : (m + PAD - 1) / PAD * PAD; /* whole vectors */
        const real *h = j->h + (LANES ? first : 0);
        int64_t read = 0;
        for (int q = 0; q < 8; q++)
            for (int64_t i = 0; i < w; i++)
                state[q][i] = j->start[q * j->n + first + (i < m ? i : m - 1)];
        for (int64_t t = 0;; t++) {
            for (; read < j->reads && j->at[read] == t; read++)
                for (int q = 0; q < 8; q++)
                    for (int64_t i = 0; i < m; i++)
                        j->out[(read * 8 + q) * j->n + first + i] = state[q][i];
            if (t == j->samples || read == j->reads)
                break;
            for (int64_t i = 0; i < w; i++) {
                const int64_t from = t * j->row + j->lane * (first + (i < m ? i : m - 1));
                given[0][i] = j->u0[from];
                given[1][i] = j->u1[from];
            }
            hold_car_kinematic_rk4(w, j->ldh, h, given, held);
            for (int64_t sub = 0; sub < j->substeps; sub++)
                step_car_kinematic_rk4(w, j->ldh, h, held, state);
        }
    }
}

INSIDE hold_motion_kinematic_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict given)[BLOCK], real (*restrict held)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real tau = given[0][i];
        const real delta = given[1][i];
        const real v41 = tau + H(8);
        const real v48 = (R(0.5) * v41) * (F(tanh)(R(100.0) * v41) + R(1.0));
        const real v50 = (-tau) + H(8);
        const real v56 = H(9) * ((R(0.5) * v50) * (F(tanh)(R(100.0) * v50) + R(1.0)));
        held[0][i] = H(6) * (v48 - v56);
        held[1][i] = H(7) * (v48 + v56);
        held[2][i] = F(tan)(delta);
    }
}

INSIDE step_motion_kinematic_rk4(int64_t w, int64_t ldh, const real *restrict h,
    real (*restrict held)[BLOCK], real (*restrict state)[BLOCK])
{
#pragma omp simd
    for (int64_t i = 0; i < w; i++) {
        const real x = state[0][i];
        const real y = state[1][i];
        const real eta = state[2][i];
        const real vx = state[3][i];
        const real v58 = held[0][i];
        const real v60 = held[1][i];
        const real v61 = held[2][i];
        const real v66 = (vx * v61) * H(11);
        const real v67 = H(1) * v66;
        const real v68 = COS(eta);
        const real v69 = F(sin)(eta);
        const real v89 = ((v58 - (v60 * vx)) + (-((H(2) * F(tanh)(H(3) * vx)) + ((H(4) + (H(5) *
            F(fabs)(vx))) * vx)))) * H(12);
        const real v91 = eta + (H(13) * v66);
        const real v93 = vx + (H(13) * v89);
        const real v95 = (v93 * v61) * H(11);
        const real v96 = H(1) * v95;
        const real v97 = COS(v91);
        const real v98 = F(sin)(v91);
        const real v117 = ((v58 - (v60 * v93)) + (-((H(2) * F(tanh)(H(3) * v93)) + ((H(4) + (H(5)
            * F(fabs)(v93))) * v93)))) * H(12);
        const real v119 = eta + (H(13) * v95);
        const real v121 = vx + (H(13) * v117);
        const real v123 = (v121 * v61) * H(11);
        const real v124 = H(1) * v123;
        const real v125 = COS(v119);
        const real v126 = F(sin)(v119);
        const real v145 = ((v58 - (v60 * v121)) + (-((H(2) * F(tanh)(H(3) * v121)) + ((H(4) +
            (H(5) * F(fabs)(v121))) * v121)))) * H(12);
        const real v147 = eta + (H(10) * v123);
        const real v149 = vx + (H(10) * v145);
        const real v151 = (v149 * v61) * H(11);
        const real v152 = H(1) * v151;
        const real v153 = COS(v147);
        const real v154 = F(sin)(v147);
        const real v198 = vx + (H(14) * ((v89 + (R(2.0) * (v117 + v145))) + (((v58 - (v60 * v149))
            + (-((H(2) * F(tanh)(H(3) * v149)) + ((H(4) + (H(5) * F(fabs)(v149))) * v149)))) *
            H(12))));
        const real v200 = (v198 * v61) / H(0);
        state[0][i] = x + (H(14) * ((((vx * v68) - (v67 * v69)) + (R(2.0) * (((v93 * v97) - (v96 *
            v98)) + ((v121 * v125) - (v124 * v126))))) + ((v149 * v153) - (v152 * v154))));
        state[1][i] = y + (H(14) * ((((vx * v69) + (v67 * v68)) + (R(2.0) * (((v93 * v98) + (v96 *
            v97)) + ((v121 * v126) + (v124 * v125))))) + ((v149 * v154) + (v152 * v153))));
        state[2][i] = eta + (H(14) * ((v66 + (R(2.0) * (v95 + v123))) + v151));
        state[3][i] = v198;
        state[4][i] = H(1) * v200;
        state[5][i] = v200;
    }
}

void run_motion_kinematic_rk4(const job *j)
{
    real state[6][BLOCK] __attribute__((aligned(64)));
    real held[3][BLOCK] __attribute__((aligned(64)));
    real given[2][BLOCK] __attribute__((aligned(64)));
    for (int64_t first = 0; first < j->n; first += BLOCK) {
        const int64_t left = j->n - first, m = left < BLOCK ? left : BLOCK;
        const int64_t w = m == 1 ? 1 : (m + PAD - 1) / PAD * PAD; /* whole vectors */
        const real *h = j->h + (LANES ? first : 0);
        int64_t read = 0;
        for (int q = 0; q < 6; q++)
            for (int64_t i = 0; i < w; i++)
                state[q][i] = j->start[q * j->n + first + (i < m ? i : m - 1)];
        for (int64_t t = 0;; t++) {
            for (; read < j->reads && j->at[read] == t; read++)
                for (int q = 0; q < 6; q++)
                    for (int64_t i = 0; i < m; i++)
                        j->out[(read * 6 + q) * j->n + first + i] = state[q][i];
            if (t == j->samples || read == j->reads)
                break;
            for (int64_t i = 0; i < w; i++) {
                const int64_t from = t * j->row + j->lane * (first + (i < m ? i : m - 1));
                given[0][i] = j->u0[from];
                given[1][i] = j->u1[from];
            }
            hold_motion_kinematic_rk4(w, j->ldh, h, given, held);
            for (int64_t sub = 0; sub < j->substeps; sub++)
                step_motion_kinematic_rk4(w, j->ldh, h, held, state);
        }
    }
}
