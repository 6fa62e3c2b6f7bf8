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
/* what would underflow takes libmvec out of its vectors, at half the speed of a step */
#define EXP(x) F(exp)(F(fmax)(x, LEAST))
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
        const real v62 = H(26) * (tau - tau_command);
        const real v64 = H(28) * (s - s_command);
        const real v65 = H(27) * v62;
        const real v66 = H(29) * v64;
        const real v68 = tau_command + (H(27) * v65);
        const real v70 = s_command + (H(29) * v66);
        const real v71 = tau_command + v62;
        const real v73 = (s_command + v64) + H(13);
        const real v79 = R(0.5) * (F(tanh)(R(30.0) * v73) + R(1.0));
        const real v89 = ((v79 * H(12)) * F(tanh)(H(11) * v73)) + (((R(1.0) - v79) * H(14)) *
            F(tanh)(H(15) * v73));
        const real v90 = tau_command + v65;
        const real v92 = (s_command + v66) + H(13);
        const real v96 = R(0.5) * (F(tanh)(R(30.0) * v92) + R(1.0));
        const real v106 = ((v96 * H(12)) * F(tanh)(H(11) * v92)) + (((R(1.0) - v96) * H(14)) *
            F(tanh)(H(15) * v92));
        const real v107 = v70 + H(13);
        const real v111 = R(0.5) * (F(tanh)(R(30.0) * v107) + R(1.0));
        const real v121 = ((v111 * H(12)) * F(tanh)(H(11) * v107)) + (((R(1.0) - v111) * H(14)) *
            F(tanh)(H(15) * v107));
        const real v122 = v71 + H(9);
        const real v128 = (R(0.5) * v122) * (F(tanh)(R(100.0) * v122) + R(1.0));
        const real v130 = (-v71) + H(9);
        const real v136 = H(10) * ((R(0.5) * v130) * (F(tanh)(R(100.0) * v130) + R(1.0)));
        const real v141 = F(sin)(v89 + R(1.5707963267948966));
        const real v142 = F(sin)(v89);
        const real v143 = v90 + H(9);
        const real v148 = (R(0.5) * v143) * (F(tanh)(R(100.0) * v143) + R(1.0));
        const real v150 = (-v90) + H(9);
        const real v156 = H(10) * ((R(0.5) * v150) * (F(tanh)(R(100.0) * v150) + R(1.0)));
        const real v158 = H(7) * (v148 - v156);
        const real v160 = H(8) * (v148 + v156);
        const real v161 = F(sin)(v106 + R(1.5707963267948966));
        const real v162 = F(sin)(v106);
        const real v163 = v68 + H(9);
        const real v168 = (R(0.5) * v163) * (F(tanh)(R(100.0) * v163) + R(1.0));
        const real v170 = (-v68) + H(9);
        const real v176 = H(10) * ((R(0.5) * v170) * (F(tanh)(R(100.0) * v170) + R(1.0)));
        const real v181 = F(sin)(v121 + R(1.5707963267948966));
        const real v182 = F(sin)(v121);
        const real v187 = vy + (H(0) * om);
        const real v190 = (vx * v141) + (v187 * v142);
        const real v205 = F(fabs)(vx);
        const real v223 = ((H(7) * (v128 - v136)) - ((H(8) * (v128 + v136)) * vx)) + (-((H(3) *
            F(tanh)(H(4) * vx)) + ((H(5) + (H(6) * v205)) * vx)));
        const real v224 = H(2) * v223;
        const real v226 = H(18) * F(atan2)((vx * v142) - (v187 * v141), F(fabs)(v190) + (R(0.1) *
            EXP((R(-100.0) * v190) * v190)));
        const real v234 = H(16) * F(sin)(H(17) * F(atan)(v226 - (H(19) * (v226 -
            F(atan)(v226)))));
        const real v238 = F(fmax)(H(32), F(fmin)(H(21), H(20) * F(atan2)((H(1) * om) - vy, v205 +
            (R(0.1) * EXP((R(-100.0) * vx) * vx)))));
        const real v241 = (v234 * v141) + (v224 * v142);
        const real v250 = F(sin)(eta + R(1.5707963267948966));
        const real v251 = F(sin)(eta);
        const real v260 = ((((H(25) * v223) + (v224 * v141)) - (v234 * v142)) * H(23)) + (om *
            vy);
        const real v263 = ((v238 + v241) * H(23)) - (om * vx);
        const real v264 = ((H(0) * v241) - (H(1) * v238)) * H(24);
        const real v266 = eta + (H(30) * om);
        const real v268 = vx + (H(30) * v260);
        const real v270 = vy + (H(30) * v263);
        const real v272 = om + (H(30) * v264);
        const real v274 = v270 + (H(0) * v272);
        const real v277 = (v268 * v161) + (v274 * v162);
        const real v290 = F(fabs)(v268);
        const real v307 = (v158 - (v160 * v268)) + (-((H(3) * F(tanh)(H(4) * v268)) + ((H(5) +
            (H(6) * v290)) * v268)));
        const real v308 = H(2) * v307;
        const real v310 = H(18) * F(atan2)((v268 * v162) - (v274 * v161), F(fabs)(v277) + (R(0.1)
            * EXP((R(-100.0) * v277) * v277)));
        const real v318 = H(16) * F(sin)(H(17) * F(atan)(v310 - (H(19) * (v310 -
            F(atan)(v310)))));
        const real v321 = F(fmax)(H(32), F(fmin)(H(21), H(20) * F(atan2)((H(1) * v272) - v270,
            v290 + (R(0.1) * EXP((R(-100.0) * v268) * v268)))));
        const real v324 = (v318 * v161) + (v308 * v162);
        const real v333 = F(sin)(v266 + R(1.5707963267948966));
        const real v334 = F(sin)(v266);
        const real v343 = ((((H(25) * v307) + (v308 * v161)) - (v318 * v162)) * H(23)) + (v272 *
            v270);
        const real v346 = ((v321 + v324) * H(23)) - (v272 * v268);
        const real v347 = ((H(0) * v324) - (H(1) * v321)) * H(24);
        const real v349 = eta + (H(30) * v272);
        const real v351 = vx + (H(30) * v343);
        const real v353 = vy + (H(30) * v346);
        const real v355 = om + (H(30) * v347);
        const real v357 = v353 + (H(0) * v355);
        const real v360 = (v351 * v161) + (v357 * v162);
        const real v373 = F(fabs)(v351);
        const real v390 = (v158 - (v160 * v351)) + (-((H(3) * F(tanh)(H(4) * v351)) + ((H(5) +
            (H(6) * v373)) * v351)));
        const real v391 = H(2) * v390;
        const real v393 = H(18) * F(atan2)((v351 * v162) - (v357 * v161), F(fabs)(v360) + (R(0.1)
            * EXP((R(-100.0) * v360) * v360)));
        const real v401 = H(16) * F(sin)(H(17) * F(atan)(v393 - (H(19) * (v393 -
            F(atan)(v393)))));
        const real v404 = F(fmax)(H(32), F(fmin)(H(21), H(20) * F(atan2)((H(1) * v355) - v353,
            v373 + (R(0.1) * EXP((R(-100.0) * v351) * v351)))));
        const real v407 = (v401 * v161) + (v391 * v162);
        const real v416 = F(sin)(v349 + R(1.5707963267948966));
        const real v417 = F(sin)(v349);
        const real v426 = ((((H(25) * v390) + (v391 * v161)) - (v401 * v162)) * H(23)) + (v355 *
            v353);
        const real v429 = ((v404 + v407) * H(23)) - (v355 * v351);
        const real v430 = ((H(0) * v407) - (H(1) * v404)) * H(24);
        const real v432 = eta + (H(22) * v355);
        const real v434 = vx + (H(22) * v426);
        const real v436 = vy + (H(22) * v429);
        const real v438 = om + (H(22) * v430);
        const real v440 = v436 + (H(0) * v438);
        const real v443 = (v434 * v181) + (v440 * v182);
        const real v456 = F(fabs)(v434);
        const real v473 = ((H(7) * (v168 - v176)) - ((H(8) * (v168 + v176)) * v434)) + (-((H(3) *
            F(tanh)(H(4) * v434)) + ((H(5) + (H(6) * v456)) * v434)));
        const real v474 = H(2) * v473;
        const real v476 = H(18) * F(atan2)((v434 * v182) - (v440 * v181), F(fabs)(v443) + (R(0.1)
            * EXP((R(-100.0) * v443) * v443)));
        const real v484 = H(16) * F(sin)(H(17) * F(atan)(v476 - (H(19) * (v476 -
            F(atan)(v476)))));
        const real v487 = F(fmax)(H(32), F(fmin)(H(21), H(20) * F(atan2)((H(1) * v438) - v436,
            v456 + (R(0.1) * EXP((R(-100.0) * v434) * v434)))));
        const real v490 = (v484 * v181) + (v474 * v182);
        const real v499 = F(sin)(v432 + R(1.5707963267948966));
        const real v500 = F(sin)(v432);
        state[0][i] = x + (H(31) * ((((vx * v250) - (vy * v251)) + (R(2.0) * (((v268 * v333) -
            (v270 * v334)) + ((v351 * v416) - (v353 * v417))))) + ((v434 * v499) - (v436 *
            v500))));
        state[1][i] = y + (H(31) * ((((vx * v251) + (vy * v250)) + (R(2.0) * (((v268 * v334) +
            (v270 * v333)) + ((v351 * v417) + (v353 * v416))))) + ((v434 * v500) + (v436 *
            v499))));
        state[2][i] = eta + (H(31) * ((om + (R(2.0) * (v272 + v355))) + v438));
        state[3][i] = vx + (H(31) * ((v260 + (R(2.0) * (v343 + v426))) + (((((H(25) * v473) +
            (v474 * v181)) - (v484 * v182)) * H(23)) + (v438 * v436))));
        state[4][i] = vy + (H(31) * ((v263 + (R(2.0) * (v346 + v429))) + (((v487 + v490) * H(23))
            - (v438 * v434))));
        state[5][i] = om + (H(31) * ((v264 + (R(2.0) * (v347 + v430))) + (((H(0) * v490) - (H(1) *
            v487)) * H(24))));
        state[6][i] = v68;
        state[7][i] = v70;
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
        const real v42 = tau + H(9);
        const real v49 = (R(0.5) * v42) * (F(tanh)(R(100.0) * v42) + R(1.0));
        const real v51 = (-tau) + H(9);
        const real v57 = H(10) * ((R(0.5) * v51) * (F(tanh)(R(100.0) * v51) + R(1.0)));
        held[0][i] = H(7) * (v49 - v57);
        held[1][i] = H(8) * (v49 + v57);
        held[2][i] = F(sin)(delta + R(1.5707963267948966));
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
        const real v59 = held[0][i];
        const real v61 = held[1][i];
        const real v62 = held[2][i];
        const real v63 = held[3][i];
        const real v68 = vy + (H(0) * om);
        const real v71 = (vx * v62) + (v68 * v63);
        const real v86 = F(fabs)(vx);
        const real v104 = (v59 - (v61 * vx)) + (-((H(3) * F(tanh)(H(4) * vx)) + ((H(5) + (H(6) *
            v86)) * vx)));
        const real v105 = H(2) * v104;
        const real v107 = H(13) * F(atan2)((vx * v63) - (v68 * v62), F(fabs)(v71) + (R(0.1) *
            EXP((R(-100.0) * v71) * v71)));
        const real v115 = H(11) * F(sin)(H(12) * F(atan)(v107 - (H(14) * (v107 -
            F(atan)(v107)))));
        const real v119 = F(fmax)(H(23), F(fmin)(H(16), H(15) * F(atan2)((H(1) * om) - vy, v86 +
            (R(0.1) * EXP((R(-100.0) * vx) * vx)))));
        const real v122 = (v115 * v62) + (v105 * v63);
        const real v131 = F(sin)(eta + R(1.5707963267948966));
        const real v132 = F(sin)(eta);
        const real v141 = ((((H(20) * v104) + (v105 * v62)) - (v115 * v63)) * H(18)) + (om * vy);
        const real v144 = ((v119 + v122) * H(18)) - (om * vx);
        const real v145 = ((H(0) * v122) - (H(1) * v119)) * H(19);
        const real v147 = eta + (H(21) * om);
        const real v149 = vx + (H(21) * v141);
        const real v151 = vy + (H(21) * v144);
        const real v153 = om + (H(21) * v145);
        const real v155 = v151 + (H(0) * v153);
        const real v158 = (v149 * v62) + (v155 * v63);
        const real v171 = F(fabs)(v149);
        const real v188 = (v59 - (v61 * v149)) + (-((H(3) * F(tanh)(H(4) * v149)) + ((H(5) + (H(6)
            * v171)) * v149)));
        const real v189 = H(2) * v188;
        const real v191 = H(13) * F(atan2)((v149 * v63) - (v155 * v62), F(fabs)(v158) + (R(0.1) *
            EXP((R(-100.0) * v158) * v158)));
        const real v199 = H(11) * F(sin)(H(12) * F(atan)(v191 - (H(14) * (v191 -
            F(atan)(v191)))));
        const real v202 = F(fmax)(H(23), F(fmin)(H(16), H(15) * F(atan2)((H(1) * v153) - v151,
            v171 + (R(0.1) * EXP((R(-100.0) * v149) * v149)))));
        const real v205 = (v199 * v62) + (v189 * v63);
        const real v214 = F(sin)(v147 + R(1.5707963267948966));
        const real v215 = F(sin)(v147);
        const real v224 = ((((H(20) * v188) + (v189 * v62)) - (v199 * v63)) * H(18)) + (v153 *
            v151);
        const real v227 = ((v202 + v205) * H(18)) - (v153 * v149);
        const real v228 = ((H(0) * v205) - (H(1) * v202)) * H(19);
        const real v230 = eta + (H(21) * v153);
        const real v232 = vx + (H(21) * v224);
        const real v234 = vy + (H(21) * v227);
        const real v236 = om + (H(21) * v228);
        const real v238 = v234 + (H(0) * v236);
        const real v241 = (v232 * v62) + (v238 * v63);
        const real v254 = F(fabs)(v232);
        const real v271 = (v59 - (v61 * v232)) + (-((H(3) * F(tanh)(H(4) * v232)) + ((H(5) + (H(6)
            * v254)) * v232)));
        const real v272 = H(2) * v271;
        const real v274 = H(13) * F(atan2)((v232 * v63) - (v238 * v62), F(fabs)(v241) + (R(0.1) *
            EXP((R(-100.0) * v241) * v241)));
        const real v282 = H(11) * F(sin)(H(12) * F(atan)(v274 - (H(14) * (v274 -
            F(atan)(v274)))));
        const real v285 = F(fmax)(H(23), F(fmin)(H(16), H(15) * F(atan2)((H(1) * v236) - v234,
            v254 + (R(0.1) * EXP((R(-100.0) * v232) * v232)))));
        const real v288 = (v282 * v62) + (v272 * v63);
        const real v297 = F(sin)(v230 + R(1.5707963267948966));
        const real v298 = F(sin)(v230);
        const real v307 = ((((H(20) * v271) + (v272 * v62)) - (v282 * v63)) * H(18)) + (v236 *
            v234);
        const real v310 = ((v285 + v288) * H(18)) - (v236 * v232);
        const real v311 = ((H(0) * v288) - (H(1) * v285)) * H(19);
        const real v313 = eta + (H(17) * v236);
        const real v315 = vx + (H(17) * v307);
        const real v317 = vy + (H(17) * v310);
        const real v319 = om + (H(17) * v311);
        const real v321 = v317 + (H(0) * v319);
        const real v324 = (v315 * v62) + (v321 * v63);
        const real v337 = F(fabs)(v315);
        const real v354 = (v59 - (v61 * v315)) + (-((H(3) * F(tanh)(H(4) * v315)) + ((H(5) + (H(6)
            * v337)) * v315)));
        const real v355 = H(2) * v354;
        const real v357 = H(13) * F(atan2)((v315 * v63) - (v321 * v62), F(fabs)(v324) + (R(0.1) *
            EXP((R(-100.0) * v324) * v324)));
        const real v365 = H(11) * F(sin)(H(12) * F(atan)(v357 - (H(14) * (v357 -
            F(atan)(v357)))));
        const real v368 = F(fmax)(H(23), F(fmin)(H(16), H(15) * F(atan2)((H(1) * v319) - v317,
            v337 + (R(0.1) * EXP((R(-100.0) * v315) * v315)))));
        const real v371 = (v365 * v62) + (v355 * v63);
        const real v380 = F(sin)(v313 + R(1.5707963267948966));
        const real v381 = F(sin)(v313);
        state[0][i] = x + (H(22) * ((((vx * v131) - (vy * v132)) + (R(2.0) * (((v149 * v214) -
            (v151 * v215)) + ((v232 * v297) - (v234 * v298))))) + ((v315 * v380) - (v317 *
            v381))));
        state[1][i] = y + (H(22) * ((((vx * v132) + (vy * v131)) + (R(2.0) * (((v149 * v215) +
            (v151 * v214)) + ((v232 * v298) + (v234 * v297))))) + ((v315 * v381) + (v317 *
            v380))));
        state[2][i] = eta + (H(22) * ((om + (R(2.0) * (v153 + v236))) + v319));
        state[3][i] = vx + (H(22) * ((v141 + (R(2.0) * (v224 + v307))) + (((((H(20) * v354) +
            (v355 * v62)) - (v365 * v63)) * H(18)) + (v319 * v317))));
        state[4][i] = vy + (H(22) * ((v144 + (R(2.0) * (v227 + v310))) + (((v368 + v371) * H(18))
            - (v319 * v315))));
        state[5][i] = om + (H(22) * ((v145 + (R(2.0) * (v228 + v311))) + (((H(0) * v371) - (H(1) *
            v368)) * H(19))));
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
        const real v70 = H(26) * (tau - tau_command);
        const real v72 = H(28) * (s - s_command);
        const real v73 = H(27) * v70;
        const real v74 = H(29) * v72;
        const real v76 = tau_command + (H(27) * v73);
        const real v78 = s_command + (H(29) * v74);
        const real v79 = tau_command + v70;
        const real v81 = (s_command + v72) + H(13);
        const real v87 = R(0.5) * (F(tanh)(R(30.0) * v81) + R(1.0));
        const real v97 = ((v87 * H(12)) * F(tanh)(H(11) * v81)) + (((R(1.0) - v87) * H(14)) *
            F(tanh)(H(15) * v81));
        const real v98 = tau_command + v73;
        const real v100 = (s_command + v74) + H(13);
        const real v104 = R(0.5) * (F(tanh)(R(30.0) * v100) + R(1.0));
        const real v114 = ((v104 * H(12)) * F(tanh)(H(11) * v100)) + (((R(1.0) - v104) * H(14)) *
            F(tanh)(H(15) * v100));
        const real v115 = v78 + H(13);
        const real v119 = R(0.5) * (F(tanh)(R(30.0) * v115) + R(1.0));
        const real v129 = ((v119 * H(12)) * F(tanh)(H(11) * v115)) + (((R(1.0) - v119) * H(14)) *
            F(tanh)(H(15) * v115));
        const real v130 = v79 + H(9);
        const real v136 = (R(0.5) * v130) * (F(tanh)(R(100.0) * v130) + R(1.0));
        const real v138 = (-v79) + H(9);
        const real v144 = H(10) * ((R(0.5) * v138) * (F(tanh)(R(100.0) * v138) + R(1.0)));
        const real v149 = F(sin)(v97 + R(1.5707963267948966));
        const real v150 = F(sin)(v97);
        const real v151 = v98 + H(9);
        const real v156 = (R(0.5) * v151) * (F(tanh)(R(100.0) * v151) + R(1.0));
        const real v158 = (-v98) + H(9);
        const real v164 = H(10) * ((R(0.5) * v158) * (F(tanh)(R(100.0) * v158) + R(1.0)));
        const real v166 = H(7) * (v156 - v164);
        const real v168 = H(8) * (v156 + v164);
        const real v169 = F(sin)(v114 + R(1.5707963267948966));
        const real v170 = F(sin)(v114);
        const real v171 = v76 + H(9);
        const real v176 = (R(0.5) * v171) * (F(tanh)(R(100.0) * v171) + R(1.0));
        const real v178 = (-v76) + H(9);
        const real v184 = H(10) * ((R(0.5) * v178) * (F(tanh)(R(100.0) * v178) + R(1.0)));
        const real v189 = F(sin)(v129 + R(1.5707963267948966));
        const real v190 = F(sin)(v129);
        const real v195 = vy + (H(0) * om);
        const real v198 = (vx * v149) + (v195 * v150);
        const real v211 = F(fabs)(vx);
        const real v228 = ((H(7) * (v136 - v144)) - ((H(8) * (v136 + v144)) * vx)) + (-((H(3) *
            F(tanh)(H(4) * vx)) + ((H(5) + (H(6) * v211)) * vx)));
        const real v229 = H(2) * v228;
        const real v235 = H(24) * F(sin)(H(16) * F(atan)(H(17) * F(atan2)((vx * v150) - (v195 *
            v149), F(fabs)(v198) + EXP((R(-3.0) * v198) * v198))));
        const real v240 = H(25) * F(sin)(H(18) * F(atan)(H(19) * F(atan2)((H(1) * om) - vy, v211 +
            EXP((R(-3.0) * vx) * vx))));
        const real v243 = (v235 * v149) + (v229 * v150);
        const real v252 = F(sin)(eta + R(1.5707963267948966));
        const real v253 = F(sin)(eta);
        const real v262 = ((((H(23) * v228) + (v229 * v149)) - (v235 * v150)) * H(21)) + (om *
            vy);
        const real v265 = ((v240 + v243) * H(21)) - (om * vx);
        const real v266 = ((H(0) * v243) - (H(1) * v240)) * H(22);
        const real v268 = eta + (H(30) * om);
        const real v270 = vx + (H(30) * v262);
        const real v272 = vy + (H(30) * v265);
        const real v274 = om + (H(30) * v266);
        const real v276 = v272 + (H(0) * v274);
        const real v279 = (v270 * v169) + (v276 * v170);
        const real v291 = F(fabs)(v270);
        const real v307 = (v166 - (v168 * v270)) + (-((H(3) * F(tanh)(H(4) * v270)) + ((H(5) +
            (H(6) * v291)) * v270)));
        const real v308 = H(2) * v307;
        const real v314 = H(24) * F(sin)(H(16) * F(atan)(H(17) * F(atan2)((v270 * v170) - (v276 *
            v169), F(fabs)(v279) + EXP((R(-3.0) * v279) * v279))));
        const real v319 = H(25) * F(sin)(H(18) * F(atan)(H(19) * F(atan2)((H(1) * v274) - v272,
            v291 + EXP((R(-3.0) * v270) * v270))));
        const real v322 = (v314 * v169) + (v308 * v170);
        const real v331 = F(sin)(v268 + R(1.5707963267948966));
        const real v332 = F(sin)(v268);
        const real v341 = ((((H(23) * v307) + (v308 * v169)) - (v314 * v170)) * H(21)) + (v274 *
            v272);
        const real v344 = ((v319 + v322) * H(21)) - (v274 * v270);
        const real v345 = ((H(0) * v322) - (H(1) * v319)) * H(22);
        const real v347 = eta + (H(30) * v274);
        const real v349 = vx + (H(30) * v341);
        const real v351 = vy + (H(30) * v344);
        const real v353 = om + (H(30) * v345);
        const real v355 = v351 + (H(0) * v353);
        const real v358 = (v349 * v169) + (v355 * v170);
        const real v370 = F(fabs)(v349);
        const real v386 = (v166 - (v168 * v349)) + (-((H(3) * F(tanh)(H(4) * v349)) + ((H(5) +
            (H(6) * v370)) * v349)));
        const real v387 = H(2) * v386;
        const real v393 = H(24) * F(sin)(H(16) * F(atan)(H(17) * F(atan2)((v349 * v170) - (v355 *
            v169), F(fabs)(v358) + EXP((R(-3.0) * v358) * v358))));
        const real v398 = H(25) * F(sin)(H(18) * F(atan)(H(19) * F(atan2)((H(1) * v353) - v351,
            v370 + EXP((R(-3.0) * v349) * v349))));
        const real v401 = (v393 * v169) + (v387 * v170);
        const real v410 = F(sin)(v347 + R(1.5707963267948966));
        const real v411 = F(sin)(v347);
        const real v420 = ((((H(23) * v386) + (v387 * v169)) - (v393 * v170)) * H(21)) + (v353 *
            v351);
        const real v423 = ((v398 + v401) * H(21)) - (v353 * v349);
        const real v424 = ((H(0) * v401) - (H(1) * v398)) * H(22);
        const real v426 = eta + (H(20) * v353);
        const real v428 = vx + (H(20) * v420);
        const real v430 = vy + (H(20) * v423);
        const real v432 = om + (H(20) * v424);
        const real v434 = v430 + (H(0) * v432);
        const real v437 = (v428 * v189) + (v434 * v190);
        const real v449 = F(fabs)(v428);
        const real v465 = ((H(7) * (v176 - v184)) - ((H(8) * (v176 + v184)) * v428)) + (-((H(3) *
            F(tanh)(H(4) * v428)) + ((H(5) + (H(6) * v449)) * v428)));
        const real v466 = H(2) * v465;
        const real v472 = H(24) * F(sin)(H(16) * F(atan)(H(17) * F(atan2)((v428 * v190) - (v434 *
            v189), F(fabs)(v437) + EXP((R(-3.0) * v437) * v437))));
        const real v477 = H(25) * F(sin)(H(18) * F(atan)(H(19) * F(atan2)((H(1) * v432) - v430,
            v449 + EXP((R(-3.0) * v428) * v428))));
        const real v480 = (v472 * v189) + (v466 * v190);
        const real v489 = F(sin)(v426 + R(1.5707963267948966));
        const real v490 = F(sin)(v426);
        state[0][i] = x + (H(31) * ((((vx * v252) - (vy * v253)) + (R(2.0) * (((v270 * v331) -
            (v272 * v332)) + ((v349 * v410) - (v351 * v411))))) + ((v428 * v489) - (v430 *
            v490))));
        state[1][i] = y + (H(31) * ((((vx * v253) + (vy * v252)) + (R(2.0) * (((v270 * v332) +
            (v272 * v331)) + ((v349 * v411) + (v351 * v410))))) + ((v428 * v490) + (v430 *
            v489))));
        state[2][i] = eta + (H(31) * ((om + (R(2.0) * (v274 + v353))) + v432));
        state[3][i] = vx + (H(31) * ((v262 + (R(2.0) * (v341 + v420))) + (((((H(23) * v465) +
            (v466 * v189)) - (v472 * v190)) * H(21)) + (v432 * v430))));
        state[4][i] = vy + (H(31) * ((v265 + (R(2.0) * (v344 + v423))) + (((v477 + v480) * H(21))
            - (v432 * v428))));
        state[5][i] = om + (H(31) * ((v266 + (R(2.0) * (v345 + v424))) + (((H(0) * v480) - (H(1) *
            v477)) * H(22))));
        state[6][i] = v76;
        state[7][i] = v78;
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
        const real v50 = tau + H(9);
        const real v57 = (R(0.5) * v50) * (F(tanh)(R(100.0) * v50) + R(1.0));
        const real v59 = (-tau) + H(9);
        const real v65 = H(10) * ((R(0.5) * v59) * (F(tanh)(R(100.0) * v59) + R(1.0)));
        held[0][i] = H(7) * (v57 - v65);
        held[1][i] = H(8) * (v57 + v65);
        held[2][i] = F(sin)(delta + R(1.5707963267948966));
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
        const real v67 = held[0][i];
        const real v69 = held[1][i];
        const real v70 = held[2][i];
        const real v71 = held[3][i];
        const real v76 = vy + (H(0) * om);
        const real v79 = (vx * v70) + (v76 * v71);
        const real v92 = F(fabs)(vx);
        const real v109 = (v67 - (v69 * vx)) + (-((H(3) * F(tanh)(H(4) * vx)) + ((H(5) + (H(6) *
            v92)) * vx)));
        const real v110 = H(2) * v109;
        const real v116 = H(19) * F(sin)(H(11) * F(atan)(H(12) * F(atan2)((vx * v71) - (v76 *
            v70), F(fabs)(v79) + EXP((R(-3.0) * v79) * v79))));
        const real v121 = H(20) * F(sin)(H(13) * F(atan)(H(14) * F(atan2)((H(1) * om) - vy, v92 +
            EXP((R(-3.0) * vx) * vx))));
        const real v124 = (v116 * v70) + (v110 * v71);
        const real v133 = F(sin)(eta + R(1.5707963267948966));
        const real v134 = F(sin)(eta);
        const real v143 = ((((H(18) * v109) + (v110 * v70)) - (v116 * v71)) * H(16)) + (om * vy);
        const real v146 = ((v121 + v124) * H(16)) - (om * vx);
        const real v147 = ((H(0) * v124) - (H(1) * v121)) * H(17);
        const real v149 = eta + (H(21) * om);
        const real v151 = vx + (H(21) * v143);
        const real v153 = vy + (H(21) * v146);
        const real v155 = om + (H(21) * v147);
        const real v157 = v153 + (H(0) * v155);
        const real v160 = (v151 * v70) + (v157 * v71);
        const real v172 = F(fabs)(v151);
        const real v188 = (v67 - (v69 * v151)) + (-((H(3) * F(tanh)(H(4) * v151)) + ((H(5) + (H(6)
            * v172)) * v151)));
        const real v189 = H(2) * v188;
        const real v195 = H(19) * F(sin)(H(11) * F(atan)(H(12) * F(atan2)((v151 * v71) - (v157 *
            v70), F(fabs)(v160) + EXP((R(-3.0) * v160) * v160))));
        const real v200 = H(20) * F(sin)(H(13) * F(atan)(H(14) * F(atan2)((H(1) * v155) - v153,
            v172 + EXP((R(-3.0) * v151) * v151))));
        const real v203 = (v195 * v70) + (v189 * v71);
        const real v212 = F(sin)(v149 + R(1.5707963267948966));
        const real v213 = F(sin)(v149);
        const real v222 = ((((H(18) * v188) + (v189 * v70)) - (v195 * v71)) * H(16)) + (v155 *
            v153);
        const real v225 = ((v200 + v203) * H(16)) - (v155 * v151);
        const real v226 = ((H(0) * v203) - (H(1) * v200)) * H(17);
        const real v228 = eta + (H(21) * v155);
        const real v230 = vx + (H(21) * v222);
        const real v232 = vy + (H(21) * v225);
        const real v234 = om + (H(21) * v226);
        const real v236 = v232 + (H(0) * v234);
        const real v239 = (v230 * v70) + (v236 * v71);
        const real v251 = F(fabs)(v230);
        const real v267 = (v67 - (v69 * v230)) + (-((H(3) * F(tanh)(H(4) * v230)) + ((H(5) + (H(6)
            * v251)) * v230)));
        const real v268 = H(2) * v267;
        const real v274 = H(19) * F(sin)(H(11) * F(atan)(H(12) * F(atan2)((v230 * v71) - (v236 *
            v70), F(fabs)(v239) + EXP((R(-3.0) * v239) * v239))));
        const real v279 = H(20) * F(sin)(H(13) * F(atan)(H(14) * F(atan2)((H(1) * v234) - v232,
            v251 + EXP((R(-3.0) * v230) * v230))));
        const real v282 = (v274 * v70) + (v268 * v71);
        const real v291 = F(sin)(v228 + R(1.5707963267948966));
        const real v292 = F(sin)(v228);
        const real v301 = ((((H(18) * v267) + (v268 * v70)) - (v274 * v71)) * H(16)) + (v234 *
            v232);
        const real v304 = ((v279 + v282) * H(16)) - (v234 * v230);
        const real v305 = ((H(0) * v282) - (H(1) * v279)) * H(17);
        const real v307 = eta + (H(15) * v234);
        const real v309 = vx + (H(15) * v301);
        const real v311 = vy + (H(15) * v304);
        const real v313 = om + (H(15) * v305);
        const real v315 = v311 + (H(0) * v313);
        const real v318 = (v309 * v70) + (v315 * v71);
        const real v330 = F(fabs)(v309);
        const real v346 = (v67 - (v69 * v309)) + (-((H(3) * F(tanh)(H(4) * v309)) + ((H(5) + (H(6)
            * v330)) * v309)));
        const real v347 = H(2) * v346;
        const real v353 = H(19) * F(sin)(H(11) * F(atan)(H(12) * F(atan2)((v309 * v71) - (v315 *
            v70), F(fabs)(v318) + EXP((R(-3.0) * v318) * v318))));
        const real v358 = H(20) * F(sin)(H(13) * F(atan)(H(14) * F(atan2)((H(1) * v313) - v311,
            v330 + EXP((R(-3.0) * v309) * v309))));
        const real v361 = (v353 * v70) + (v347 * v71);
        const real v370 = F(sin)(v307 + R(1.5707963267948966));
        const real v371 = F(sin)(v307);
        state[0][i] = x + (H(22) * ((((vx * v133) - (vy * v134)) + (R(2.0) * (((v151 * v212) -
            (v153 * v213)) + ((v230 * v291) - (v232 * v292))))) + ((v309 * v370) - (v311 *
            v371))));
        state[1][i] = y + (H(22) * ((((vx * v134) + (vy * v133)) + (R(2.0) * (((v151 * v213) +
            (v153 * v212)) + ((v230 * v292) + (v232 * v291))))) + ((v309 * v371) + (v311 *
            v370))));
        state[2][i] = eta + (H(22) * ((om + (R(2.0) * (v155 + v234))) + v313));
        state[3][i] = vx + (H(22) * ((v143 + (R(2.0) * (v222 + v301))) + (((((H(18) * v346) +
            (v347 * v70)) - (v353 * v71)) * H(16)) + (v313 * v311))));
        state[4][i] = vy + (H(22) * ((v146 + (R(2.0) * (v225 + v304))) + (((v358 + v361) * H(16))
            - (v313 * v309))));
        state[5][i] = om + (H(22) * ((v147 + (R(2.0) * (v226 + v305))) + (((H(0) * v361) - (H(1) *
            v358)) * H(17))));
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
        const real v185 = F(sin)(eta + R(1.5707963267948966));
        const real v186 = F(sin)(eta);
        const real v206 = (((H(6) * (v146 - v154)) - ((H(7) * (v146 + v154)) * vx)) + (-((H(2) *
            F(tanh)(H(3) * vx)) + ((H(4) + (H(5) * F(fabs)(vx))) * vx)))) * H(17);
        const real v208 = eta + (H(22) * v183);
        const real v210 = vx + (H(22) * v206);
        const real v212 = (v210 * v178) * H(16);
        const real v213 = H(1) * v212;
        const real v214 = F(sin)(v208 + R(1.5707963267948966));
        const real v215 = F(sin)(v208);
        const real v234 = ((v175 - (v177 * v210)) + (-((H(2) * F(tanh)(H(3) * v210)) + ((H(4) +
            (H(5) * F(fabs)(v210))) * v210)))) * H(17);
        const real v236 = eta + (H(22) * v212);
        const real v238 = vx + (H(22) * v234);
        const real v240 = (v238 * v178) * H(16);
        const real v241 = H(1) * v240;
        const real v242 = F(sin)(v236 + R(1.5707963267948966));
        const real v243 = F(sin)(v236);
        const real v262 = ((v175 - (v177 * v238)) + (-((H(2) * F(tanh)(H(3) * v238)) + ((H(4) +
            (H(5) * F(fabs)(v238))) * v238)))) * H(17);
        const real v264 = eta + (H(15) * v240);
        const real v266 = vx + (H(15) * v262);
        const real v268 = (v266 * v140) * H(16);
        const real v269 = H(1) * v268;
        const real v270 = F(sin)(v264 + R(1.5707963267948966));
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
        const real v68 = F(sin)(eta + R(1.5707963267948966));
        const real v69 = F(sin)(eta);
        const real v89 = ((v58 - (v60 * vx)) + (-((H(2) * F(tanh)(H(3) * vx)) + ((H(4) + (H(5) *
            F(fabs)(vx))) * vx)))) * H(12);
        const real v91 = eta + (H(13) * v66);
        const real v93 = vx + (H(13) * v89);
        const real v95 = (v93 * v61) * H(11);
        const real v96 = H(1) * v95;
        const real v97 = F(sin)(v91 + R(1.5707963267948966));
        const real v98 = F(sin)(v91);
        const real v117 = ((v58 - (v60 * v93)) + (-((H(2) * F(tanh)(H(3) * v93)) + ((H(4) + (H(5)
            * F(fabs)(v93))) * v93)))) * H(12);
        const real v119 = eta + (H(13) * v95);
        const real v121 = vx + (H(13) * v117);
        const real v123 = (v121 * v61) * H(11);
        const real v124 = H(1) * v123;
        const real v125 = F(sin)(v119 + R(1.5707963267948966));
        const real v126 = F(sin)(v119);
        const real v145 = ((v58 - (v60 * v121)) + (-((H(2) * F(tanh)(H(3) * v121)) + ((H(4) +
            (H(5) * F(fabs)(v121))) * v121)))) * H(12);
        const real v147 = eta + (H(10) * v123);
        const real v149 = vx + (H(10) * v145);
        const real v151 = (v149 * v61) * H(11);
        const real v152 = H(1) * v151;
        const real v153 = F(sin)(v147 + R(1.5707963267948966));
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
