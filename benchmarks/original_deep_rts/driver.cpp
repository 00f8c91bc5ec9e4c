// Plays one workload of benchmarks/deep_rts.py on the original engine, one game at a time.
//
//   deep_rts_original --map FILE --players N [--rich] [--copy-state] [--max-ticks N]
//                     [--seconds S] [--processor-time]
//
// Each player does a random action of the 16 at each tick. The actions are drawn before the clock
// starts. Whole games are played, resets included, until the seconds are over; one more comes
// before. The last line of the output is a JSON object.

#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <exception>
#include <iostream>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "Config.h"
#include "Constants.h"
#include "Game.h"
#include "Player.h"

namespace {

constexpr std::size_t NUM_ACTIONS_DRAWN = 65521;  // prime: the players do not repeat in step
constexpr int TICKS_PER_COUNT = 256;              // of the units
constexpr int RICH_STOCK = 1000000;
constexpr int RICH_FOOD = 50;

struct Workload {
    std::string map;
    int players = 0;
    std::uint64_t max_ticks = 10000;
    double seconds = 1.0;
    bool rich = false;
    bool copy_state = false;
    bool processor_time = false;
};

Workload read_arguments(int count, char** values) {
    Workload workload;
    for (int i = 1; i < count; ++i) {
        const std::string name = values[i];
        const auto value = [&]() -> std::string {
            if (i + 1 == count) throw std::invalid_argument(name + " needs a value");
            return values[++i];
        };
        if (name == "--map") workload.map = value();
        else if (name == "--players") workload.players = std::stoi(value());
        else if (name == "--max-ticks") workload.max_ticks = std::stoull(value());
        else if (name == "--seconds") workload.seconds = std::stod(value());
        else if (name == "--rich") workload.rich = true;
        else if (name == "--copy-state") workload.copy_state = true;
        else if (name == "--processor-time") workload.processor_time = true;
        else throw std::invalid_argument("unknown argument " + name);
    }
    if (workload.map.empty()) throw std::invalid_argument("--map is required");
    if (workload.players < 1) throw std::invalid_argument("--players must be at least 1");
    return workload;
}

DeepRTS::Config make_config(const Workload& workload) {
    DeepRTS::Config config = DeepRTS::Config::defaults();
    config.setGUI("");
    config.setBarracks(true);
    config.setFootman(true);
    config.setArcher(true);
    config.setInstantTownHall(true);
    if (workload.rich) {
        config.setStartGold(RICH_STOCK);
        config.setStartLumber(RICH_STOCK);
        config.setStartFood(RICH_FOOD);
    }
    return config;
}

class Runner {
    const Workload workload;
    DeepRTS::Game game;
    std::vector<std::uint8_t> actions;
    std::size_t next = 0;
    std::vector<double> state;

    void play_tick() {
        for (auto& player : game.players) {
            player.do_action(actions[next]);
            if (++next == actions.size()) next = 0;
        }
        game.update();
        if (workload.copy_state) {
            std::memcpy(state.data(), game.state.data(), state.size() * sizeof(double));
            asm volatile("" : : "r"(state.data()) : "memory");  // the copy is not optimized away
        }
    }

public:
    std::uint64_t ticks = 0, games = 0;
    int most_units = 0;

    explicit Runner(const Workload& given) : workload(given), game(given.map, make_config(given)) {
        for (int i = 0; i < workload.players; ++i) game.addPlayer();
        if (static_cast<int>(game.players.size()) != workload.players)
            throw std::invalid_argument(workload.map + " has no place for so many players");
        std::mt19937 engine(0);
        std::uniform_int_distribution<int> draw(DeepRTS::Constants::ACTION_MIN,
                                                DeepRTS::Constants::ACTION_MAX);
        actions.resize(NUM_ACTIONS_DRAWN);
        for (auto& action : actions) action = static_cast<std::uint8_t>(draw(engine));
        state.resize(game.state.size());
        game.setMaxFPS(0);
        game.start();
    }

    void play_game() {
        while (!game.isTerminal() && game.ticks < workload.max_ticks) {
            play_tick();
            if (game.ticks % TICKS_PER_COUNT == 0) count_units();
        }
        count_units();
        ticks += game.ticks;
        ++games;
        game.reset();
    }

    void count_units() {
        int units = 0;
        for (const auto& player : game.players) units += player.getUnitCount();
        if (units > most_units) most_units = units;
    }
};

double wall_seconds() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double processor_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

}  // namespace

int main(int count, char** values) {
    try {
        const Workload workload = read_arguments(count, values);
        Runner runner(workload);
        runner.play_game();
        runner.ticks = runner.games = 0;
        const auto clock = workload.processor_time ? processor_seconds : wall_seconds;
        const double start = clock();
        double elapsed = 0.0;
        do {
            runner.play_game();
            elapsed = clock() - start;
        } while (elapsed < workload.seconds);
        std::cout << "{\"ticks_per_second\": " << static_cast<std::uint64_t>(runner.ticks / elapsed)
                  << ", \"ticks\": " << runner.ticks << ", \"games\": " << runner.games
                  << ", \"most_units\": " << runner.most_units << "}" << std::endl;
        return EXIT_SUCCESS;
    } catch (const std::exception& error) {
        std::cerr << error.what() << std::endl;
        return EXIT_FAILURE;
    }
}
