classdef RelnavFilter < matlab.System
    % Estimates in Simulink: a MATLAB System block around relnav.Navigator, in MATLAB's own process.
    %
    % Once a session: pyenv(Version="/path/to/.venv/bin/python")
    % In the model: a MATLAB System block, System object name RelnavFilter, Simulate using: Interpreted execution.
    %
    % Inputs: time s; spots 6x1 m (x and y of beacons A, B, C; NaN: not seen); commanded acceleration 3x1 m/s^2.
    % Outputs: state 6x1 m, m/s in lvlh_ccsds (NaN: no state yet); covariance 6x6; alarm, 0: to be relied on.

    properties (Nontunable)
        Model = 'three_beacon_psd'   % a shipped model, or the path of a model.toml
        Method = 'fix'
    end

    properties (Access = private)
        Navigator
    end

    methods (Access = protected)
        function setupImpl(obj)
            obj.Navigator = py.relnav.Navigator(py.relnav.load_model(obj.Model), pyargs('method', obj.Method));
        end

        function [state, covariance, alarm] = stepImpl(obj, t, spots, acceleration)
            rows = py.numpy.array(reshape(spots, 2, 3)');   % a row a beacon
            record = obj.Navigator.step(t, rows, pyargs('acceleration_m_s2', py.numpy.array(acceleration(:)')));
            state = double(record.state)';
            covariance = double(record.covariance);
            alarm = double(py.int(record.alarm));
        end

        function resetImpl(obj)
            obj.setupImpl();
        end

        function [a, b, c] = getOutputSizeImpl(~)
            [a, b, c] = deal([6 1], [6 6], [1 1]);
        end

        function [a, b, c] = getOutputDataTypeImpl(~)
            [a, b, c] = deal('double');
        end

        function [a, b, c] = isOutputComplexImpl(~)
            [a, b, c] = deal(false);
        end

        function [a, b, c] = isOutputFixedSizeImpl(~)
            [a, b, c] = deal(true);
        end
    end
end
