<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: from the first pass (orange) over green to the last (blue). -->
<qgis version="3.34.0" styleCategories="Symbology|Labeling|MapTips|Temporal|Rendering">
 <temporal enabled="1" mode="1" startField="end" endField="" startExpression="" endExpression="" durationField="" durationUnit="ms" fixedDuration="0" limitMode="0" accumulate="1">
  <fixedRange>
   <start></start>
   <end></end>
  </fixedRange>
 </temporal>
 <renderer-v2 type="categorizedSymbol" attr="if(maximum(&quot;pass&quot;) = minimum(&quot;pass&quot;), 'between', if(&quot;pass&quot; = minimum(&quot;pass&quot;), 'first', if(&quot;pass&quot; = maximum(&quot;pass&quot;), 'last', 'between')))" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <categories>
   <category value="first" type="string" symbol="0" label="first pass" render="true"/>
   <category value="between" type="string" symbol="1" label="passes between" render="true"/>
   <category value="last" type="string" symbol="2" label="last pass" render="true"/>
  </categories>
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="181,220,196,255"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="70,70,70,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.2"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="fillColor" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="ramp_color(create_ramp(map(0, '#b5dcc4', 0.5, '#2e8b57', 1, '#123f29')), if(maximum(&quot;pass&quot;) &gt; 1, (&quot;pass&quot; - 1) / (maximum(&quot;pass&quot;) - 1), 0.5))"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="fill" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="46,139,87,255"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="70,70,70,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.2"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="fillColor" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="ramp_color(create_ramp(map(0, '#b5dcc4', 0.5, '#2e8b57', 1, '#123f29')), if(maximum(&quot;pass&quot;) &gt; 1, (&quot;pass&quot; - 1) / (maximum(&quot;pass&quot;) - 1), 0.5))"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="fill" name="2" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="18,63,41,255"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="70,70,70,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.2"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="fillColor" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="ramp_color(create_ramp(map(0, '#b5dcc4', 0.5, '#2e8b57', 1, '#123f29')), if(maximum(&quot;pass&quot;) &gt; 1, (&quot;pass&quot; - 1) / (maximum(&quot;pass&quot;) - 1), 0.5))"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <labeling type="simple">
  <settings calloutType="simple">
   <text-style fieldName="pass" fontSize="10" fontSizeUnit="Point" fontFamily="Sans" textColor="40,40,40,255" isExpression="0">
    <text-buffer bufferDraw="1" bufferSize="1" bufferSizeUnits="MM" bufferColor="255,255,255,220"/>
   </text-style>
  </settings>
 </labeling>
 <layerOpacity>0.65</layerOpacity>
 <mapTip enabled="1">&lt;b&gt;pass [% "pass" %]&lt;/b&gt;, [% format_date("start", 'HH:mm:ss') %] to [% format_date("end", 'HH:mm:ss') %] UTC&lt;br&gt;[% coalesce(format_number("area_m2", max(0, 1 - floor(log10(2 * "area_sigma_m2")))) || ' ± ' || format_number(round(2 * "area_sigma_m2", 1 - floor(log10(2 * "area_sigma_m2"))), max(0, 1 - floor(log10(2 * "area_sigma_m2")))) || ' m² (95 %)', format_number("area_m2", 1) || ' m²') %], [% format_number("length_m", 1) %] m&lt;br&gt;[% format_number(3.6 * "speed_mps", 1) %] km/h, depth (approximate) [% coalesce(format_number(100 * "depth_m", max(0, 1 - floor(log10(200 * "depth_sigma_m")))) || ' ± ' || format_number(round(200 * "depth_sigma_m", 1 - floor(log10(200 * "depth_sigma_m"))), max(0, 1 - floor(log10(200 * "depth_sigma_m")))) || ' cm (95 %)', format_number(100 * "depth_m", 0) || ' cm', 'unknown') %]</mapTip>
</qgis>
