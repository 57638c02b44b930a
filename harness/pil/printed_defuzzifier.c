/* printed_defuzzifier: eq. 3.19 to 3.21 as printed, summed over the 1501 points, to measure its time
 * Source: Miller 2010, 3.3.5.2. The onboard program has the same sum in closed form. */

float printed_speed; /* m/s, 0 or more: set at pil_wait */
float printed_sigma; /* m/s2: to be read at pil_done */

void pil_wait(void);
void pil_done(void);

static float smaller(float a, float b)
{
    return (a < b) ? a : b;
}

static float larger(float a, float b)
{
    return (a < b) ? b : a;
}

static float low(float x)
{
    return (x < 0.2f) ? ((0.2f - x) / 0.2f) : 0.0f;
}

static float medium(float x)
{
    return (!(x < 0.2f) && (x < 3.0f)) ? ((3.0f - x) / 2.8f) : 0.0f;
}

static float high(float x)
{
    float mu = 0.0f;

    if ((!(x < 3.0f)) && (x < 4.0f)) {
        mu = x - 3.0f;
    } else if ((!(x < 4.0f)) && (x < 300.0f)) {
        mu = 1.0f;
    }
    return mu;
}

static float defuzzify(float stopped, float walking, float running)
{
    float moment = 0.0f;
    float area = 0.0f;
    int i;

    for (i = 0; i <= 1500; i++) {
        const float x = 0.2f * (float)i;
        const float mu = larger(larger(smaller(stopped, low(x)), smaller(walking, medium(x))), smaller(running, high(x)));

        moment += x * mu;
        area += mu;
    }
    return moment / area;
}

static float process_noise(float v)
{
    const float stopped = (v < 0.5f) ? ((0.5f - v) / 0.5f) : 0.0f;
    float walking = 0.0f;
    float running = 0.0f;

    if (v < 0.5f) {
        walking = v / 0.5f;
    } else if (v < 3.0f) {
        walking = 1.0f;
    } else if (v < 4.0f) {
        walking = 4.0f - v;
        running = v - 3.0f;
    } else {
        running = 1.0f;
    }
    return defuzzify(stopped, walking, running);
}

int main(void)
{
    for (;;) {
        pil_wait();
        printed_sigma = process_noise(printed_speed);
        pil_done();
    }
}
