"""Where each number of a joint stands: packed numbers P, switches S, columns of the result."""

# --- numbers of the packed vector P -------------------------------------------------------------------------------
J_M, J_L, K, C, B_M, B_L = 0, 1, 2, 3, 4, 5
G_COS, G_SIN, G_CONST = 6, 7, 8  # gravity: -(G_COS cos q - G_SIN sin q) - G_CONST [N m]
GAP_HALF, GAP_CENTRE, GAP_DAMPING = 9, 10, 11  # half play [rad], its centre [rad], share of c inside it [-]
K_2, K_3, K_SOFT, SOFT_ANGLE = 12, 13, 14, 15  # K_SOFT: stiffness missing within +-SOFT_ANGLE
HYST_TORQUE, HYST_ANGLE = 16, 17
REID, REID_OMEGA = 18, 19  # loss factor of the rate-independent structural law, and its scaling frequency [rad/s]
DRIFT = 20  # relative stiffness change per second [1/s]
FM_PLUS, FM_MINUS, FM_EXCESS, FM_SPEED, FM_EXPONENT, FM_LOAD = 21, 22, 23, 24, 25, 26
FL_PLUS, FL_MINUS, FL_EXCESS, FL_SPEED, FL_EXPONENT, FL_LOAD = 27, 28, 29, 30, 31, 32
C_QUADRATIC = 33
STOP_ANGLE, STOP_K, STOP_C, STOP_EXPONENT, STOP_SIDE = 34, 35, 36, 37, 38
LINK_J, LINK_OMEGA, LINK_ZETA, LINK_HIT, LINK_SENSE = 39, 40, 41, 42, 43
NEAR_J, NEAR_OMEGA, NEAR_ZETA = 44, 45, 46
BASE_SHARE, BASE_OMEGA, BASE_ZETA = 47, 48, 49
LOOP_MIX, LOOP_P, LOOP_I, LOOP_LIMIT = 50, 51, 52, 53
OBS_1, OBS_2, OBS_QS, OBS_VS, OBS_Q, OBS_V = 54, 55, 56, 57, 58, 59
MOTOR_ZERO = 60  # recorded motor angle / n minus the model's q_s [rad]: phase reference of motor orders
TE_0 = 61  # three lines of (amplitude, per q_s, per q, phase)
RIPPLE_0 = 73  # three lines of (amplitude, share of tau, per q_s, phase)
BRANCH_0 = 85  # branches of (stiffness, relaxation time)
MOST_BRANCHES = 5
TABLE_LOW, TABLE_STEP, TABLE_0 = 95, 96, 97  # a law as torque [N m] at nodes of a variable
N_NODES = 9
C_SIDED = 106  # viscous damping more in positive motion and less in negative [N m s/rad]
PRE_TORQUE, PRE_ANGLE = 107, 108  # dry friction with presliding: torque [N m], angle over which it builds up [rad]
BASE_HIT, BASE_TURN, BASE_SLIDE = 109, 110, 111  # force on the mount per torque on the arm beyond 1; lever a + b/r
ROUND_M, ROUND_M_SPEED, ROUND_L, ROUND_L_SPEED = (
    112,
    113,
    114,
    115,
)  # friction T tanh(w/w_e): torque [N m], w_e [rad/s]
PRE_EXCESS, PRE_SPEED = (
    116,
    117,
)  # breakaway beyond PRE_TORQUE as its share, and the speed over which it falls [rad/s]
ROUND_M_EXCESS, ROUND_M_FALL, ROUND_L_EXCESS, ROUND_L_FALL = (
    118,
    119,
    120,
    121,
)  # breakaway beyond ROUND_M as its share, and the speed over which it falls [rad/s]
ROUND_M_SIDED, ROUND_L_SIDED = 122, 123  # share by which it is larger in positive motion and smaller in negative
PRE_SIDED = 124  # the same of friction with presliding
PAR_SHARE, PAR_MOTOR, PAR_LOAD, PAR_PHASE = (
    125,
    126,
    127,
    128,
)  # stiffness K (1 + share sin(per q_s, per q, phase))
RUB = 129  # damping in proportion to the wind-up [N m s/rad^2]
HYST_SHAPE = 130  # delta/gamma of Bouc and Wen: 1 unloads straight, 0 is Dahl's law, below -1 the loop stiffens
PRE_DAMPING = 131  # LuGre's sigma_1 over PRE_TORQUE [s/rad]
PRE_BRITTLE = 132  # 1 less Dahl's exponent: 0 is an exponential approach, towards 1 a spring that slips
PRE_LOAD = 133  # presliding friction per transmitted torque [-], beside PRE_TORQUE
ROUND_M_LOAD, ROUND_L_LOAD = 134, 135  # the same of rounded friction
HYST_LEVEL_0, SLIP_ELEMENTS = (
    136,
    8,
)  # Maxwell-slip: limits of equal springs, each over HYST_ANGLE; their mean is 1
PRE_EXPONENT = 144  # 1 where the breakaway falls as exp(-v/PRE_SPEED), else as exp(-(v/PRE_SPEED)^2)
GAP_ROUND, GAP_FADE, GAP_SHEDS = (
    145,
    146,
    147,
)  # depth over which a flank gives way [rad], power to which its damping does, 1 where flanks don't pull
SOFT_SMOOTH = 148  # 1 where what a soft middle misses fades as el d^2/(el^2 + d^2), not at a corner
GAP_CORNER = 149  # half width of a bend in place of the corners of a play [rad]; below zero one that ends sooner
ROUND_M_QUADRANT, ROUND_L_QUADRANT = (
    150,
    151,
)  # share by which friction per torque is less where the torque drives the motion, and more where it brakes it
GAP_IMPACT = 152  # damping per elastic torque [s/rad]: Hunt and Crossley's
TE_REACTS = 153  # 1 where a kinematic error does no work: T_S drives what turns it, too
POW_K, POW_ANGLE, POW_EXPONENT = (
    154,
    155,
    156,
)  # stiffness [N m/rad] that |el|/angle to the power exponent - 1 adds
DIRECT = 157  # 1 on a rigid axis: what drives it is what passes through it, and its own angle is the motor's
PASSED, GEAR_SHARE = (
    158,
    159,
)  # on a rigid axis: friction per torque ahead of where that is taken (below zero: behind it); J_M over the rest of J_L
N_P = 160

# --- integers of the switch vector S ------------------------------------------------------------------------------
N_X, AT_LINK, AT_NEAR, AT_BASE, AT_BRANCH, N_BRANCH, AT_LOOP = 0, 1, 2, 3, 4, 5, 6
MOTOR, HYST_KIND, N_TE, N_RIPPLE, FRICTION_M, FRICTION_L, LOAD_PRESCRIBED = 7, 8, 9, 10, 11, 12, 13
TABLE_SITE, TABLE_OF = 14, 15
PRE_SITE = 16
N_S = 17
MOTOR_FREE, MOTOR_HELD, MOTOR_PRESCRIBED = 0, 1, 2
DAHL, BOUC_WEN, MAXWELL_SLIP, ELASTIC_SLIP, BOUC_WEN_SHAPED = 1, 2, 3, 4, 5
AT_MOTOR, AT_LOAD, AT_TRANSMISSION = 1, 2, 3  # TABLE_SITE
OF_SPEED, OF_ANGLE, OF_WIND_UP, OF_WIND_UP_RATE, OF_TURN = 0, 1, 2, 3, 4  # TABLE_OF; of turn: a stiffness

# --- columns of the result ----------------------------------------------------------------------------------------
X_QS, X_VS, X_AS, X_Q, X_V, X_A, X_LINK, X_TS, X_TAU, X_TEXT = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
X_MOUNT = 10
N_OUT = 11

# --- of the steppers ----------------------------------------------------------------------------------------------
N_AUX = 17  # diagnostics of one evaluation
MEM_SLIP = 10  # of the memory: first of the slipping springs
MEM_TURN = (
    MEM_SLIP + SLIP_ELEMENTS
)  # (argument, sine, cosine) about which each line is expanded: errors, then ripples
LINES_EACH = 3
MEM_SEAT = MEM_TURN + 6 * LINES_EACH  # flank of a play whose law is taken through a step; 2: as the wind-up says
N_MEM = MEM_SEAT + 1  # before all these the wind-up, a loop, weight's angle from 5 on, bristles from 8 on
MAX_EVENTS = 12  # pieces into which dry friction may cut one step

# --- what a scalar stepper holds beside the plain joint: bits -----------------------------------------------------------
HAS_MODE, HAS_BRANCHES = 1, 2  # one mode, relaxation branches
HAS_LINES = 4  # kinematic error, torque ripple
HAS_SPRINGS = 8  # springs and plays with bends, powers, impacts
HAS_LOOPS = 16  # hysteresis, rate-independent damping, tables
HAS_RUBS = 32  # rounded friction, bristles
HAS_ALL = 63
