// Estimates for a C++ program: rows go to `relnav filter --follow` through a pipe, JSON lines come back through another.
//
//     g++ -std=c++17 -O2 -o follow examples/live/follow.cpp
//     ./follow three_beacon_psd < examples/basilisk_approach/vbar_log.csv
//
// Standard input stands for your camera: a header and rows of a log. POSIX.

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <sys/wait.h>
#include <unistd.h>

/// One line of `--format jsonl`: flat, names in quotes, numbers or null, which becomes NaN.
std::map<std::string, double> numbers(const std::string& line) {
    std::map<std::string, double> out;
    for (std::size_t at = line.find('"'); at != std::string::npos; at = line.find('"', at)) {
        const std::size_t end = line.find('"', at + 1), value = line.find_first_not_of(": ", end + 1);
        out[line.substr(at + 1, end - at - 1)] =
            line.compare(value, 4, "null") == 0 ? std::nan("") : std::strtod(line.c_str() + value, nullptr);
        at = line.find_first_of(",}", value);
    }
    return out;
}

/// The filter as another process: a row in, its estimate out.
class Filter {
public:
    Filter(const std::string& model, const std::string& header) {
        int rows[2], lines[2];
        if (pipe(rows) != 0 || pipe(lines) != 0) throw std::runtime_error("no pipe");
        child_ = fork();
        if (child_ == 0) {
            dup2(rows[0], 0), dup2(lines[1], 1);
            for (int end : {rows[0], rows[1], lines[0], lines[1]}) close(end);
            execlp("relnav", "relnav", "filter", "--follow", "-", "--model", model.c_str(), "--format", "jsonl",
                   "--quiet", static_cast<char*>(nullptr));
            _exit(127);
        }
        close(rows[0]), close(lines[1]);
        rows_ = fdopen(rows[1], "w"), lines_ = fdopen(lines[0], "r");
        send(header);
    }

    ~Filter() {
        fclose(rows_), fclose(lines_);
        waitpid(child_, nullptr, 0);
    }

    /// Not after a row that is none: such a row is told on standard error and has no estimate.
    std::map<std::string, double> step(const std::string& row) {
        send(row);
        if (getline(&text_, &size_, lines_) < 0) throw std::runtime_error("relnav has ended");
        return numbers(text_);
    }

private:
    void send(const std::string& row) { fputs((row + "\n").c_str(), rows_), fflush(rows_); }

    pid_t child_;
    FILE *rows_, *lines_;
    char* text_ = nullptr;
    std::size_t size_ = 0;
};

int main(int count, char** arguments) {
    std::string row;
    do std::getline(std::cin, row);
    while (!row.empty() && row[0] == '#');
    Filter filter(count > 1 ? arguments[1] : "three_beacon_psd", row);
    while (std::getline(std::cin, row)) {
        auto now = filter.step(row);
        if (std::isnan(now["x_m"]) || now["alarm"] != 0) continue;  // no state yet, or not to be relied on
        std::printf("%.1f s: x %.4f m +- %.4f m, closing at %.4f m/s\n", now["t_s"], now["x_m"], now["sigma_x_m"],
                    -now["vx_m_s"]);
    }
}
