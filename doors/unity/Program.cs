// A console program that steps an organ from C#, and checks what it gets:
//     mcs -out:sample.exe doors/unity/{Native,Sinew,Program}.cs && LD_LIBRARY_PATH=target/binding mono sample.exe demos/meshes/liver.msh
using System;
using System.Runtime.InteropServices;
using Sinew;

static class Program
{
    static void Demand(bool right, string what)
    {
        if (!right) { Console.Error.WriteLine("wrong: " + what); Environment.Exit(1); }
    }

    static ulong Run(string path, bool tell)
    {
        using (var mesh = MeshHandle.FromFile(path))
        using (var simulation = new Simulation(0.01, new Vec3(0.0, 0.0, -9.81), 1))
        {
            simulation.Solver = "mass_damping = 4.0";
            var liver = simulation.AddBody("liver", mesh, "liver", 0.0);
            simulation.Hold(liver, "ligament", simulation.Group(liver, "ligament"));
            var tool = simulation.Hold(liver, "tool", simulation.Group(liver, "tool"));
            for (int i = 1; i <= 20; i++)
            {
                simulation.MoveConstraint(tool, new Vec3(0.001 * i, 0.0, 0.001 * i));
                simulation.Step(1);
            }
            var force = simulation.Reaction(tool);
            Demand(Math.Abs(simulation.Time - 0.2) < 1e-12, "the time");
            Demand(force.Length > 0.01 && force.Length < 100.0, "the force, " + force.Length + " N");
            // positions as doubles and straight into a buffer are the same
            var exact = simulation.Read(liver, Quantity.Positions);
            var floats = new float[exact.Length];
            var pin = GCHandle.Alloc(floats, GCHandleType.Pinned);
            simulation.Positions(liver, pin.AddrOfPinnedObject(), floats.Length / 3, 12);
            pin.Free();
            for (int i = 0; i < exact.Length; i++) { Demand((float)exact[i] == floats[i], "position " + i); }
            // a ray from above, a pull, a ball, a cut
            var at = new Vec3(exact[0], exact[1], exact[2]);
            double low = double.MaxValue, high = double.MinValue, x = 0.0, y = 0.0;
            for (int i = 0; i < exact.Length; i += 3)
            {
                if (exact[i + 2] > high) { high = exact[i + 2]; x = exact[i]; y = exact[i + 1]; }
                low = Math.Min(low, exact[i + 2]);
            }
            var pick = simulation.Ray(new Vec3(x, y, high + 1.0), new Vec3(1e-6, 1e-6, -1.0));
            if (pick.Hit)
            {
                var pull = simulation.AddPull("hand", pick, 20.0, 0.1);
                simulation.MovePull(pull, new Vec3(0.0, 0.0, 0.01));
                simulation.Step(2);
                simulation.Remove(pull);
            }
            var ball = simulation.AddBall("finger", new Vec3(x, y, high + 0.05), 0.01, 0.1, ToolFlags.ErrorBar);
            simulation.MoveTool(ball, new Vec3(x, y, high + 0.005));
            simulation.Step(1);
            simulation.MoveTool(ball, new Vec3(x, y, high + 0.004));
            simulation.Step(1);
            var felt = simulation.ToolReport(ball);
            Demand(felt.Depth >= 0.0 && felt.Energy >= 0.0 && felt.DrawnIn >= 0.0, "what the ball feels");
            // 1 mm in a step of 10 ms
            Demand(Math.Abs(felt.Velocity.Z + 0.1) < 1e-9 && felt.AngularVelocity.Length == 0.0, "the velocity of the ball");
            Demand(felt.Force.Length == 0.0 || felt.OtherPoints.Length > 0.0, "the force by other points");
            // back by bytes and before a cut, and the same cut again
            var before = simulation.SurfaceRevision(liver);
            using (var start = simulation.Snapshot())
            using (var read = SnapshotHandle.FromBytes(start.ToBytes()))
            {
                simulation.Step(1);
                simulation.Restore(read);
                simulation.RemoveBall(liver, at, 0.03);
                simulation.Step(1);
                var after = simulation.Hash;
                simulation.Restore(start);
                Demand(simulation.RemoveBall(liver, at, 0.03) > 0, "elements after going back");
                simulation.Step(1);
                Demand(simulation.Hash == after, "the state after going back");
                simulation.Restore(start);
                before = simulation.SurfaceRevision(liver);
            }
            var cut = simulation.RemoveBall(liver, at, 0.03);
            Demand(cut > 0 && simulation.SurfaceRevision(liver) == before + 1, "the cut");
            Demand(simulation.Surface(liver).Length % 3 == 0, "the surface");
            simulation.Step(1);
            try { simulation.Remove(12345); Demand(false, "a wrong handle"); }
            catch (SinewException error)
            {
                Demand(error.Code == Code.Handle && error.Message.Contains("12345"), "the text of an error");
            }
            if (tell) { Console.WriteLine("{0:F3} N, {1} elements cut, state {2:x16}", force.Length, cut, simulation.Hash); }
            return simulation.Hash;
        }
    }

    /// <summary>A block is cut, stitched and torn.</summary>
    static void Wound()
    {
        var corner = new double[] { 0, 0, 0, 0.1, 0, 0, 0, 0.1, 0, 0.1, 0.1, 0, 0, 0, 0.1, 0.1, 0, 0.1, 0, 0.1, 0.1, 0.1, 0.1, 0.1 };
        var cube = new uint[] { 0, 1, 3, 7, 0, 3, 2, 7, 0, 2, 6, 7, 0, 6, 4, 7, 0, 4, 5, 7, 0, 5, 1, 7 };
        using (var mesh = MeshHandle.FromArrays(corner, cube))
        using (var simulation = new Simulation(0.01, new Vec3(), 1))
        {
            var body = simulation.AddBody("cube", mesh, "liver", 0.0, 400);
            simulation.Hold(body, "floor", new uint[] { 0, 1, 2, 3 });
            var report = simulation.Cut(body, new[] { 0.052, -1, 0.2, 0.052, -1, 0.04, 0.052, 1, 0.2, 0.052, 1, 0.04 });
            uint[] triangles, wound;
            var points = simulation.Skin(body, out triangles, out wound);
            int open = 0;
            for (int t = 0; t < wound.Length; t++)
            {
                if (wound[t] == 0) { continue; }
                open++;
                Demand(Math.Abs(points[3 * triangles[3 * t]] - 0.052) < 1e-9, "a side of the wound");
            }
            Demand(open > 1 && report.Area > 0.005, "the wound");
            var left = new ThreadPoint(body, new Vec3(0.03, 0.05, 0.09));
            var right = new ThreadPoint(body, new Vec3(0.07, 0.05, 0.09));
            var hand = new ThreadPoint(0, new Vec3(0.05, 0.05, 0.12));
            var stitch = simulation.AddThread(Kind.Thread, "name = \"stitch\"\nstiffness = 20.0", left, right, hand);
            simulation.AddThread(Kind.Clip, "name = \"clip\"\nstiffness = 1.0", left, right);
            var edge = "ends = [[0, 0, 0.2], [0, 0, 0.05]]\ninto = [0, 1, 0]\ntoughness = 50.0";
            var knife = simulation.AddBlade("knife", new Vec3(0.081, -0.005, 0), edge);
            for (int i = 1; i <= 20; i++)
            {
                simulation.DrawThread(stitch, 1, 1e-3 * i);
                simulation.MoveThread(stitch, 2, new Vec3(0.05, 0.05, 0.12 + 1e-4 * i));
                simulation.MoveTool(knife, new Vec3(0.081, 0.002 * i - 0.005, 0));
                simulation.Step(1);
            }
            Demand(simulation.Read(stitch, Quantity.ThreadReport)[0] > 0.0, "the tension");
            Demand(simulation.Read(stitch, Quantity.ThreadSpans).Length == 2, "the spans");
            Demand(simulation.ToolReport(knife).CutArea > 0.0, "the area of the knife");
            simulation.TieThread(stitch);
            simulation.Step(1);
            Demand(simulation.CutThread(stitch, 0) == stitch, "the part that is left");
            simulation.SetTear(body, "strength = 1.0");
            Demand(simulation.Read(body, Quantity.Tear).Length == 8, "the tear");
            simulation.SetTear(body, null);
        }
    }

    /// <summary>A device and a reader, which outlive their simulation.</summary>
    static void Live(string path)
    {
        HapticDevice device;
        LiveReader reader;
        ulong liver, step;
        double seconds;
        double[] last;
        using (var mesh = MeshHandle.FromFile(path))
        using (var simulation = new Simulation(0.01, new Vec3(), 1))
        {
            liver = simulation.AddBody("liver", mesh, "liver", 0.0);
            simulation.Hold(liver, "ligament", simulation.Group(liver, "ligament"));
            simulation.AddHaptic("hand", liver, simulation.Group(liver, "tool"), out device);
            reader = simulation.Share();
            var felt = device.Exchange(new Vec3(), new Vec3(), 0.001);
            Demand(felt.Flags == (uint)HapticFlags.HapticWaiting && felt.Force.Length == 0.0, "a device before a step");
            for (int i = 1; i <= 100; i++)
            {
                felt = device.Exchange(new Vec3(0.0, 0.0, 1e-5 * i), new Vec3(), 0.001);
                if (i % 10 == 0) { simulation.Step(1); }
            }
            Demand(felt.Force.Z < 0.0 && felt.Step == 9, "the force on a hand");
            HapticDevice turner;
            var jaws = simulation.AddHaptic("jaws", liver, simulation.Group(liver, "tool"), out turner, 0.0, true);
            for (int i = 0; i <= 20; i++)
            {
                var half = 5e-3 * i;
                felt = turner.Exchange(new Vec3(), new[] { 0.0, 0.0, Math.Sin(half), Math.Cos(half) }, new Vec3(), new Vec3(), 0.01);
                if (i % 10 == 0) { simulation.Step(1); }
            }
            Demand(felt.Torque.Z < 0.0 && (felt.Flags & (uint)HapticFlags.HapticBadInput) == 0, "the torque on a hand");
            simulation.Release(jaws);
            turner.Dispose();
            last = simulation.Read(liver, Quantity.Positions);
        }
        Demand(reader.Update(out step, out seconds) && step == 13, "the step of a reader");
        var seen = reader.Positions(liver);
        for (int i = 0; i < last.Length; i++) { Demand(seen[i] == last[i], "position " + i + " of a reader"); }
        Demand(reader.Normals(liver).Length == last.Length && !reader.Update(out step, out seconds), "a reader");
        HapticFeedback silent = new HapticFeedback();
        for (int i = 0; i < 120; i++) { silent = device.Exchange(new Vec3(0.0, 0.0, 1e-3), new Vec3(), 0.001); }
        Demand(silent.Force.Length == 0.0 && (silent.Flags & (uint)HapticFlags.HapticStale) != 0, "a device without a simulation");
        device.Dispose();
        reader.Dispose();
    }

    static int Main(string[] arguments)
    {
        var path = arguments.Length > 0 ? arguments[0] : "demos/meshes/liver.msh";
        Demand(Run(path, true) == Run(path, false), "two runs, two results");
        var corner = MeshHandle.FromArrays(new double[] { 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1 }, new uint[] { 0, 1, 2, 3 });
        corner.Dispose();
        Wound();
        Live(path);
        try { MeshHandle.FromFile("no.msh"); Demand(false, "a file that is not there"); }
        catch (SinewException error) { Demand(error.Code == Code.Io, "its code"); }
        return 0;
    }
}
